"""Persistent jobs that experimenters request and follow, such as transcodings and simulations.

Each job is a row, and runs in a child process, one at a time. The process writes its progress and a
heartbeat. A job without a recent heartbeat, because its server was stopped, is restarted.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy import and_, or_, select, update
from sqlalchemy.engine import CursorResult

from app.services.accounts.accounts import Principal
from app.services.background.job_function import JobHandler
from app.services.runtime import disk_quota
from app.services.runtime.errors import NotFoundError, ServiceError
from app.services.runtime.ids import new_public_id
from app.services.runtime.settings import Settings
from app.storage.database import Database
from app.storage.models.records import Job

from .context import AppContext, utc_now

log = logging.getLogger(__name__)

WAITING, RUNNING, DONE, FAILED = "waiting", "running", "done", "failed"
#: A running job without a heartbeat for so long is restarted.
SILENT_AFTER = timedelta(seconds=60)
#: Interval of heartbeats in seconds.
BEAT_S = 5.0
#: A job whose worker was lost is itself lost after two missing heartbeats.
LOST_AFTER = timedelta(seconds=2 * BEAT_S)
#: Shortest interval between two writes of progress, in seconds.
_WRITE_EVERY_S = 1.0


class JobStillRunningError(Exception):
    """The job's process is still running: it has a recent heartbeat."""


@dataclass(frozen=True)
class JobInfo:
    """The state and progress of a job. message: its result, or why it failed, as a sentence."""

    public_id: str
    kind: str
    state: str
    done: int
    total: int
    message: str | None
    request: Mapping[str, Any]

    @property
    def is_over(self) -> bool:
        """Whether the job is done or has failed."""
        return self.state in (DONE, FAILED)


def enqueue(
    app: AppContext,
    caller: Principal,
    kind: str,
    request: Mapping[str, Any],
    study_id: int | None = None,
) -> JobInfo:
    """Create a job and start it. The caller's unfinished job with the same request is returned.

    kind: a key of `app.job_handlers`. request: JSON object for the handler. Raises ServiceError for
    an unknown kind, and NoRoomError, because every kind of job writes to the disk.
    """
    if kind not in app.job_handlers:
        raise ServiceError(f"expected work among {', '.join(app.job_handlers)}, got {kind!r}")
    disk_quota.require(app.settings, app.settings.data_dir)
    with app.database.write() as db:
        under_way = db.scalars(
            select(Job).where(
                Job.kind == kind,
                Job.account_id == caller.account_id,
                Job.study_id.is_(study_id) if study_id is None else Job.study_id == study_id,
                Job.state.in_((WAITING, RUNNING)),
            )
        )
        job = next((one for one in under_way if one.request == dict(request)), None)
        if job is None:
            job = Job(
                public_id=new_public_id(),
                account_id=caller.account_id,
                study_id=study_id,
                kind=kind,
                state=WAITING,
                done=0,
                total=1,
                request=dict(request),
                created_at=app.now(),
            )
            db.add(job)
            db.flush()
        info = _info(job)
    _start(app, info)
    return info


def status(app: AppContext, caller: Principal, public_id: str) -> JobInfo:
    """The state of the caller's job; stalled jobs are restarted. Raises NotFoundError."""
    with app.database.read() as db:
        job = db.scalar(
            select(Job).where(Job.public_id == public_id, Job.account_id == caller.account_id)
        )
        if job is None:
            raise NotFoundError("there is no such job")
        info = _info(job)
    if not info.is_over:
        restart_stalled(app)
    return info


def newest(
    app: AppContext, kind: str, *, study_id: int | None = None, **request: Any
) -> JobInfo | None:
    """The newest job of this kind, or None.

    study_id: only jobs of this study. request: only jobs whose request has these items.
    """
    statement = select(Job).where(Job.kind == kind).order_by(Job.id.desc())
    if study_id is not None:
        statement = statement.where(Job.study_id == study_id)
    with app.database.read() as db:
        for job in db.scalars(statement):
            if request.items() <= job.request.items():
                return _info(job)
    return None


def restart_stalled(app: AppContext) -> None:
    """Start all waiting jobs, and those that run without a recent heartbeat."""
    since = utc_now() - SILENT_AFTER
    with app.database.read() as db:
        found = db.scalars(
            select(Job)
            .where(
                or_(
                    Job.state == WAITING,
                    and_(Job.state == RUNNING, or_(Job.seen_at.is_(None), Job.seen_at < since)),
                )
            )
            .order_by(Job.id)
        )
        waiting = [_info(job) for job in found]
    for info in waiting:
        _start(app, info)


def run(settings: Settings, public_id: str, work: JobHandler) -> None:
    """Execute a job; the entry point of its child process. Returns if another process has it."""
    database = Database(settings.url)
    stop = threading.Event()
    try:
        request = _mark_running(database, public_id)
        if request is None:
            return
        beat = threading.Thread(target=_beat, args=(database, public_id, stop), daemon=True)
        beat.start()
        try:
            message = work(settings, request, _Reporter(database, public_id))
            state = DONE
        except Exception as error:
            log.exception("the job %s failed", public_id)
            state, message = FAILED, f"{error}" or type(error).__name__
        with database.write() as db:
            values: dict[str, Any] = {"state": state, "message": message, "ended_at": utc_now()}
            if state == DONE:
                values["done"] = Job.total
            db.execute(update(Job).where(Job.public_id == public_id).values(**values))
    finally:
        stop.set()
        database.close()


def _start(app: AppContext, info: JobInfo) -> None:
    work = app.job_handlers.get(info.kind)
    if work is None:
        return
    app.background.as_job(
        info.public_id,
        run,
        app.settings,
        info.public_id,
        work,
        died=lambda code: process_died(app.database, info.public_id, code),
    )


def claim(database: Database, public_id: str, lost_after: timedelta = LOST_AFTER) -> str | None:
    """Claim a job for a worker, and return its kind; None if it is over or was deleted.

    The task queue gives a job to one worker at a time, so an earlier worker is known to be lost.
    Raises JobStillRunningError if the job's process sent a heartbeat less than `lost_after` ago.
    """
    with database.write() as db:
        job = db.scalar(select(Job).where(Job.public_id == public_id).with_for_update())
        if job is None or job.state in (DONE, FAILED):
            return None
        if job.state == RUNNING:
            if job.seen_at is not None and job.seen_at > utc_now() - lost_after:
                raise JobStillRunningError(f"the job {public_id} is in somebody's hands")
            job.state = WAITING
        return job.kind


def release(database: Database, public_id: str) -> None:
    """Set a job back to waiting after its process was terminated."""
    with database.write() as db:
        db.execute(
            update(Job)
            .where(Job.public_id == public_id, Job.state == RUNNING)
            .values(state=WAITING)
        )


def fail(database: Database, public_id: str, message: str) -> None:
    """Mark an unfinished job as failed, with this message."""
    with database.write() as db:
        db.execute(
            update(Job)
            .where(Job.public_id == public_id, Job.state.in_((WAITING, RUNNING)))
            .values(state=FAILED, message=message, ended_at=utc_now())
        )


def process_died(database: Database, public_id: str, code: int) -> None:
    """Mark a job as failed after its process was killed: a restart would likely end the same way.

    code: the exit status.
    """
    fail(database, public_id, f"its process ended before its time (status {code})")


def _mark_running(database: Database, public_id: str) -> Mapping[str, Any] | None:
    now = utc_now()
    is_free = or_(
        Job.state == WAITING,
        and_(Job.state == RUNNING, or_(Job.seen_at.is_(None), Job.seen_at < now - SILENT_AFTER)),
    )
    with database.write() as db:
        result = db.execute(
            update(Job)
            .where(Job.public_id == public_id, is_free)
            .values(state=RUNNING, started_at=now, seen_at=now)
        )
        assert isinstance(result, CursorResult)
        if result.rowcount == 0:
            return None
        request: dict[str, Any] = db.scalars(
            select(Job.request).where(Job.public_id == public_id)
        ).one()
        return request


def _beat(database: Database, public_id: str, stop: threading.Event) -> None:
    while not stop.wait(BEAT_S):
        with database.write() as db:
            db.execute(update(Job).where(Job.public_id == public_id).values(seen_at=utc_now()))


class _Reporter:
    """Writes the progress of a job, at most once a second."""

    def __init__(self, database: Database, public_id: str) -> None:
        self._database = database
        self._public_id = public_id
        self._written = 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._written < _WRITE_EVERY_S:
            return
        self._written = now
        with self._database.write() as db:
            db.execute(
                update(Job)
                .where(Job.public_id == self._public_id)
                .values(done=min(done, total), total=total, seen_at=utc_now())
            )


def _info(job: Job) -> JobInfo:
    return JobInfo(
        public_id=job.public_id,
        kind=job.kind,
        state=job.state,
        done=job.done,
        total=job.total,
        message=job.message,
        request=dict(job.request),
    )
