"""The machine inside the server: the simulated crane, which records rollouts of `machine crane`.

It claims rollouts as any machine does, renders them in child processes, and hands the videos in. If
its process is killed, the lease ends, and another process takes the rollout over.
"""

from __future__ import annotations

import hashlib
import logging
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Final

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from app.crane import single_run
from app.crane.dynamics import DURATION_S
from app.services.context import AppContext
from app.services.recordings.recordings import file_locator
from app.services.runtime.errors import ServiceError
from app.services.studies import repository
from app.storage.models.rollouts import OUTSTANDING, Rollout
from app.storage.models.studies import Study
from app.study.environments import CRANE_PARAMETERS

from . import acceptance, claims, machines, reports, requests, work_signal
from .machines import MachineCaller
from .outcomes import Made

log = logging.getLogger(__name__)

#: Lease of a claim in seconds, and the interval in which it is renewed: a run takes two seconds of
#: CPU, and evaluators wait for the end of the lease if the process is killed.
LEASE: Final = timedelta(seconds=20)
_RENEW_S: Final = 5.0
#: Longest time in seconds after which a thread that waits for a rendering notices a stop.
_WAIT_S: Final = 0.25
#: Longest time between two looks for work, in seconds. What this process asks is seen at once.
_LOOK_EVERY_S: Final = 1.0


@contextmanager
def running(app: AppContext) -> Iterator[None]:
    """Run the machine in threads of this process during the block.

    As many runs are rendered at a time as the settings say. Leaving the block ends the threads;
    rollouts that they have claimed are given back.
    """
    stop, wake = threading.Event(), threading.Event()

    def look() -> None:
        while not stop.is_set():
            wake.wait(_LOOK_EVERY_S)
            wake.clear()
            while not stop.is_set() and work_once(app, stop):
                pass

    threads = [
        threading.Thread(target=look, name=f"crane machine {number}", daemon=True)
        for number in range(app.settings.render_jobs)
    ]
    with work_signal.listening(wake.set):
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            stop.set()
            wake.set()
            for thread in threads:
                thread.join()


def work_once(app: AppContext, stop: threading.Event | None = None) -> bool:
    """Record the next rollout of a crane machine, in any study. Returns False if there is none.

    stop: when set, the rollout under way is given back.
    """
    try:
        caller = _study_with_work(app)
        if caller is None:
            return False
        claimed = claims.claim(app, caller, inside=True, lease=LEASE)
        if claimed is None:
            return False
    except (SQLAlchemyError, ServiceError) as error:
        # The database is away, which others report, or the study has just been deleted.
        log.debug("the crane could not look for work: %s", type(error).__name__)
        return False
    try:
        _record(app, caller, claimed, stop or threading.Event())
    except Exception as error:
        log.exception("the crane failed at a rollout")
        _report(app, caller, claimed, f"{type(error).__name__}: {error}")
    return True


def _study_with_work(app: AppContext) -> MachineCaller | None:
    """The machine of a study in which the crane could claim a rollout; None without any."""
    with app.database.read() as db:
        waiting = db.scalars(
            select(Rollout.study_id).where(Rollout.status.in_(OUTSTANDING)).distinct()
        ).all()
        found = claims.claimable(db, waiting, app.now()) if waiting else {}
        for study_id, environment in found:
            if claims.plan_of(db, study_id).environments[environment].is_crane_machine:
                slug = db.scalars(select(Study.slug).where(Study.id == study_id)).one()
                break
        else:
            return None
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        machine = machines.without_token(db, study.id, machines.INSIDE, app.now())
        machine.last_seen_at = app.now()
        return MachineCaller(machine.id, machine.name, study.id, slug)


def _record(
    app: AppContext, caller: MachineCaller, claimed: claims.Claimed, stop: threading.Event
) -> None:
    w0, w1 = (float(claimed.parameters[name]) for name in CRANE_PARAMETERS)
    attempt = claimed.attempt
    with tempfile.TemporaryDirectory(prefix="recording-", dir=app.settings.data_dir) as folder:
        path = Path(folder) / "run.mp4"
        future = app.background.in_process(
            ("crane rollout", claimed.public_id, attempt),
            single_run.record,
            *(claimed.environment, (w0, w1), claimed.seed, path),
            urgent=claimed.reason == requests.QUERY,
        )
        run = _result(app, caller, claimed, future, stop)
        if run is None:
            _report(app, caller, claimed, "stopped before the run", give_back=True)
            return
        with path.open("rb") as content:
            sha256 = hashlib.file_digest(content, "sha256").hexdigest()
        made = Made(
            locator=file_locator(sha256, "mp4"),
            sha256=sha256,
            duration_s=DURATION_S,
            score=run.score,
            series={"weight_g": list(run.weight)},
        )
        # Made by this program: it need not be decoded as a stranger's is.
        acceptance.keep(app, caller, claimed.public_id, attempt, path, made)


def _result(
    app: AppContext,
    caller: MachineCaller,
    claimed: claims.Claimed,
    future: Future[single_run.RecordedRun],
    stop: threading.Event,
) -> single_run.RecordedRun | None:
    """The result of a rendering, for which the lease is renewed; None if it did not begin.

    A rendering that has begun is finished even if the process is told to stop: it takes seconds.
    """
    renewed = time.monotonic()
    is_stopped = False
    while True:
        try:
            return future.result(timeout=_WAIT_S)
        except TimeoutError:
            if future.done():
                raise
        if (stop.is_set() or is_stopped) and future.cancel():
            return None
        if time.monotonic() - renewed >= _RENEW_S:
            renewed = time.monotonic()
            beat = claims.heartbeat(
                app, caller, claimed.public_id, attempt=claimed.attempt, lease=LEASE
            )
            is_stopped = beat.is_stopped


def _report(
    app: AppContext,
    caller: MachineCaller,
    claimed: claims.Claimed,
    reason: str,
    *,
    give_back: bool = False,
) -> None:
    try:
        reports.failed(
            app,
            caller,
            claimed.public_id,
            reason,
            attempt=claimed.attempt,
            give_back=give_back,
        )
    except (ServiceError, SQLAlchemyError):
        # The lease ends by itself.
        log.warning("the crane could not report on a rollout", exc_info=True)
