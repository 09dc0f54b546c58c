"""The periodic tasks of a server: a table of tasks with periods, and the thread that runs them.

A task that fails is logged and tried again when it is next due; the others are not affected.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from sqlalchemy.exc import SQLAlchemyError

from app.services.context import AppContext
from app.services.ethics import bundle
from app.services.rollouts import uploads
from app.services.studies import deleted_studies, orphaned_videos
from app.storage.advisory_lock import AdvisoryLock, try_advisory_lock

from . import abandoned_sessions, evict_deleted_trials, expired_drafts, partial_files, retention

log = logging.getLogger(__name__)

#: Called between two steps of a task: True ends it early, and the next run continues.
Stop = Callable[[], bool]

HOUR_S = 3600.0


@dataclass(frozen=True)
class Task:
    """One periodic task.

    name: completes the log message "deleted 3 ...". run: returns the number of deleted items.
    """

    name: str
    period_s: float
    run: Callable[[AppContext, Stop], int]


#: Run by every process, for its own memory and its own machine's folders.
OF_EACH_PROCESS = (
    Task(
        "deleted trials from memory", 60.0, lambda app, _: evict_deleted_trials.evict_deleted(app)
    ),
    Task("unfinished videos", HOUR_S, partial_files.delete_partial),
    Task("partial uploads of machines", HOUR_S, uploads.delete_old),
)
#: Run by one server or worker at a time, for the whole installation.
OF_THE_STUDIO = (
    Task("rows and ids that were due by a retention rule", HOUR_S, retention.delete_due),
    Task("sessions without consent", HOUR_S, abandoned_sessions.delete_abandoned),
    Task("abandoned drafts", HOUR_S, expired_drafts.delete_expired),
    Task("videos of no study", HOUR_S, orphaned_videos.sweep),
    Task("sessions of deleted studies", HOUR_S, lambda app, _: deleted_studies.sweep(app)),
    Task("old failure counts", HOUR_S, lambda app, _: app.failures.delete_old()),
    Task("expired ethics bundles", HOUR_S, bundle.delete_leftovers),
)


def run_all(app: AppContext, stop: Stop = lambda: False) -> None:
    """Run the tasks of the installation now, unless another server or worker is running them."""
    try:
        with try_advisory_lock(app.database, AdvisoryLock.RETENTION) as is_alone:
            if is_alone:
                for task in OF_THE_STUDIO:
                    _run(app, task, stop)
    except SQLAlchemyError:
        log.exception("whether another server runs the periodic tasks could not be asked")


@contextmanager
def running(app: AppContext, *, of_the_studio: bool) -> Iterator[None]:
    """Run the tasks in a thread during the block: immediately, and then each after its period.

    of_the_studio: whether to run the tasks of the whole installation as well. Leaving the block
    waits for the running task, because the database is closed afterwards.
    """
    stopping = threading.Event()
    rounds: list[tuple[float, Callable[[], None]]] = [
        (task.period_s, partial(_run, app, task, stopping.is_set)) for task in OF_EACH_PROCESS
    ]
    if of_the_studio:
        rounds.append((HOUR_S, partial(run_all, app, stopping.is_set)))
    thread = threading.Thread(
        target=_repeat, args=(rounds, stopping), name="periodic tasks", daemon=True
    )
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()


def _repeat(rounds: Sequence[tuple[float, Callable[[], None]]], stopping: threading.Event) -> None:
    due = [0.0] * len(rounds)
    while not stopping.is_set():
        for index, (period_s, run) in enumerate(rounds):
            if time.monotonic() >= due[index] and not stopping.is_set():
                run()
                due[index] = time.monotonic() + period_s
        stopping.wait(max(min(due) - time.monotonic(), 0))


def _run(app: AppContext, task: Task, stop: Stop) -> None:
    try:
        number = task.run(app, stop)
    except Exception:
        log.exception("deleting %s failed, and is tried again", task.name)
    else:
        if number:
            log.info("deleted %d %s", number, task.name)
