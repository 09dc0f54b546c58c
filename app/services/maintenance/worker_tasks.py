"""What a worker does for the servers: videos, jobs, and keeping studies' word on retention.

Each task is done to its end or given back: whoever takes it up next goes on with what is missing.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Coroutine
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any, TypeVar

import procrastinate
from procrastinate.jobs import Job
from sqlalchemy.exc import OperationalError

from app.services import jobs
from app.services.background.job_process import JobProcesses
from app.services.background.remote import format_error
from app.services.context import AppContext
from app.services.recordings import recordings
from app.services.runtime.errors import StoreAwayError
from app.storage.task_queue import (
    GONE_AFTER_S,
    JOB,
    RENDER,
    RETENTION,
    Task,
    TaskQueue,
    procrastinate_connector,
)

from . import periodic_tasks

log = logging.getLogger(__name__)

#: A task that took so many workers with it, or so many processes, is not tried again.
MOST_LOSSES = 3
#: How long why a task failed is kept, in hours.
_FAULTS_KEPT_H = 24
#: How long somebody who still has a job in hand is waited for before the next look, in seconds.
_IN_HANDS_S = 2
#: What passes by itself is given so long to do so, in seconds.
_PASSES_S = 2

T = TypeVar("T")


@dataclass(frozen=True)
class HeartbeatConfig:
    """How often a worker is heard of, and how long it may be silent until it is given up.

    beat_s: between two signs of life. gone_after_s: then others take its tasks. job_lost_after_s:
    for a job, its own process must have been silent for so long as well. All in seconds.
    """

    beat_s: float = 2.0
    gone_after_s: float = GONE_AFTER_S
    job_lost_after_s: float = jobs.LOST_AFTER.total_seconds()


class TaskReleasedError(Exception):
    """The worker was told to stop before the task was done."""


class WorkerTasks:
    """A worker's hands: processes for videos, one for a job at a time, a thread for the rest."""

    def __init__(self, app: AppContext, queue: TaskQueue, heartbeat: HeartbeatConfig) -> None:
        self._studio = app
        self._heartbeat = heartbeat
        self._queue = queue
        self._jobs = JobProcesses()
        self._stopping = threading.Event()

    def app(self) -> procrastinate.App:
        """What Procrastinate has to know: where the queue is, and who does which task."""
        queue_app = procrastinate.App(connector=procrastinate_connector(self._studio.settings.url))
        again = _RetryStrategy()
        queue_app.task(name=RENDER, queue=RENDER, retry=again, pass_context=True)(self._render)
        queue_app.task(name=JOB, queue=JOB, retry=again, pass_context=True)(self._job)
        alone = Task(RETENTION, "").key
        sweep = queue_app.task(
            name=RETENTION,
            queue=RETENTION,
            retry=again,
            lock=alone,
            queueing_lock=alone,
            pass_context=True,
        )(self._sweep)
        # Each hour once, however many workers there are: the queue sees to that.
        queue_app.periodic(cron="0 * * * *")(sweep)
        return queue_app

    def enqueue_retention(self) -> None:
        """A sweep now, as when a server starts: the next full hour may be far."""
        self._queue.enqueue(Task(RETENTION, ""))

    def stop(self) -> None:
        """Give back the job in hand, and begin no other; a sweep ends after its next deletion."""
        self._stopping.set()
        self._jobs.close()

    def requeue_stalled(self) -> None:
        """Let those tasks be done by others whose worker was not heard of any more."""
        for lost in self._queue.requeue_stalled(self._heartbeat.gone_after_s, MOST_LOSSES):
            log.warning("a worker was lost", extra={"task": lost.name, "what": lost.argument})
            if lost.is_over and lost.name == JOB:
                jobs.fail(self._studio.database, lost.argument, lost.fault)

    async def _render(
        self, context: procrastinate.JobContext, /, argument: str, **_noted: object
    ) -> None:
        await self._run_logged(context.job, self._make_video(argument))

    async def _job(
        self, context: procrastinate.JobContext, /, argument: str, **_noted: object
    ) -> None:
        await self._run_logged(context.job, self._do_job(argument))

    async def _sweep(
        self, context: procrastinate.JobContext, /, timestamp: int = 0, **_noted: object
    ) -> None:
        await asyncio.to_thread(periodic_tasks.run_all, self._studio, self._stopping.is_set)
        # Nobody waits for these any more.
        await context.app.job_manager.delete_old_jobs(
            _FAULTS_KEPT_H, include_failed=True, include_cancelled=True, include_aborted=True
        )

    async def _make_video(self, locator: str) -> None:
        making = self._studio.background.in_process(
            (RENDER, locator), recordings.make_video, self._studio.settings, locator, urgent=True
        )
        await _uncancelled(making)

    async def _do_job(self, public_id: str) -> None:
        database, job_handlers = self._studio.database, self._studio.job_handlers
        lost_after = timedelta(seconds=self._heartbeat.job_lost_after_s)
        kind = await asyncio.to_thread(jobs.claim, database, public_id, lost_after)
        if kind is None:
            return
        if kind not in job_handlers:
            raise LookupError(f"expected work among {', '.join(job_handlers)}, got {kind!r}")
        running = self._jobs.submit(
            public_id,
            jobs.run,
            (self._studio.settings, public_id, job_handlers[kind]),
            partial(jobs.process_died, database, public_id),
        )
        if not await _uncancelled(running):
            await asyncio.to_thread(jobs.release, database, public_id)
            raise TaskReleasedError

    async def _run_logged(self, task: Job, doing: Coroutine[Any, Any, None]) -> None:
        """Log the task when it is done; where it fails for good, say why to who waits for it."""
        began = time.monotonic()
        try:
            await doing
        except Exception as error:
            if _decision(error, task) is None:
                fault = format_error(error)
                log.error("failed", extra=_log_fields(task) | {"fault": fault})
                await asyncio.to_thread(self._fail, task, fault)
            raise
        log.info("done", extra=_log_fields(task) | {"s": round(time.monotonic() - began, 3)})

    def _fail(self, task: Job, fault: str) -> None:
        assert task.id is not None
        self._queue.note_fault(task.id, fault)
        if task.task_name == JOB:
            jobs.fail(self._studio.database, str(task.task_kwargs["argument"]), fault)


class _RetryStrategy(procrastinate.BaseRetryStrategy):
    def get_retry_decision(
        self, *, exception: BaseException, job: Job
    ) -> procrastinate.RetryDecision | None:
        return _decision(exception, job)


async def _uncancelled(work: Future[T]) -> T:
    """What comes of the work, which goes on and is logged where nobody can wait for it."""
    done = asyncio.wrap_future(work)
    done.add_done_callback(lambda it: it.cancelled() or it.exception())
    return await asyncio.shield(done)


def _decision(error: BaseException, task: Job) -> procrastinate.RetryDecision | None:
    """When the task is tried again after an error; None where that would be of no use."""
    if isinstance(error, jobs.JobStillRunningError):
        return procrastinate.RetryDecision(retry_in={"seconds": _IN_HANDS_S})
    if isinstance(error, TaskReleasedError | asyncio.CancelledError):
        return procrastinate.RetryDecision(retry_in={"seconds": 0})
    # Its process was killed, for want of memory say, or the database or the store of recordings was
    # away: no fault of its own.
    passing = isinstance(error, BrokenProcessPool | OperationalError | StoreAwayError)
    if passing and task.attempts + 1 < MOST_LOSSES:
        return procrastinate.RetryDecision(retry_in={"seconds": _PASSES_S})
    return None


def _log_fields(task: Job) -> dict[str, object]:
    return {"task": task.task_name, "what": task.task_kwargs.get("argument")}
