"""The tasks of a worker, as Procrastinate runs them: rendering, jobs, and periodic cleanup.

A task either finishes or is requeued, and its next run does only what is missing.
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

#: A task during which so many workers or processes died is not retried.
MOST_LOSSES = 3
#: How long failed tasks are kept, in hours.
_FAULTS_KEPT_H = 24
#: Delay before retrying a job whose earlier process still runs, in seconds.
_IN_HANDS_S = 2
#: Delay before retrying after a temporary failure, in seconds.
_PASSES_S = 2

T = TypeVar("T")


@dataclass(frozen=True)
class HeartbeatConfig:
    """Heartbeat of workers, in seconds.

    beat_s: interval. gone_after_s: silence after which a worker's tasks are requeued.
    job_lost_after_s: silence of a job's own process after which the job may be restarted.
    """

    beat_s: float = 2.0
    gone_after_s: float = GONE_AFTER_S
    job_lost_after_s: float = jobs.LOST_AFTER.total_seconds()


class TaskReleasedError(Exception):
    """The worker was stopped before the task was finished, so the task is requeued."""


class WorkerTasks:
    """Runs renderings in a process pool, jobs one at a time in a process, cleanup in a thread."""

    def __init__(self, app: AppContext, queue: TaskQueue, heartbeat: HeartbeatConfig) -> None:
        self._app = app
        self._heartbeat = heartbeat
        self._queue = queue
        self._jobs = JobProcesses()
        self._stopping = threading.Event()

    def app(self) -> procrastinate.App:
        """The Procrastinate app with the queue's connection and the three tasks."""
        queue_app = procrastinate.App(connector=procrastinate_connector(self._app.settings.url))
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
        # Once an hour in total: the queueing lock keeps several workers from repeating it.
        queue_app.periodic(cron="0 * * * *")(sweep)
        return queue_app

    def enqueue_retention(self) -> None:
        """Enqueue a cleanup now, as when a server starts; the next full hour may be far away."""
        self._queue.enqueue(Task(RETENTION, ""))

    def stop(self) -> None:
        """Terminate the running job, which is requeued; a cleanup ends after its next deletion."""
        self._stopping.set()
        self._jobs.close()

    def requeue_stalled(self) -> None:
        """Requeue the tasks of workers that stopped sending heartbeats."""
        for lost in self._queue.requeue_stalled(self._heartbeat.gone_after_s, MOST_LOSSES):
            log.warning("a worker was lost", extra={"task": lost.name, "what": lost.argument})
            if lost.is_over and lost.name == JOB:
                jobs.fail(self._app.database, lost.argument, lost.fault)

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
        await asyncio.to_thread(periodic_tasks.run_all, self._app, self._stopping.is_set)
        # No server waits for these any longer.
        await context.app.job_manager.delete_old_jobs(
            _FAULTS_KEPT_H, include_failed=True, include_cancelled=True, include_aborted=True
        )

    async def _make_video(self, locator: str) -> None:
        making = self._app.background.in_process(
            (RENDER, locator), recordings.make_video, self._app.settings, locator, urgent=True
        )
        await _uncancelled(making)

    async def _do_job(self, public_id: str) -> None:
        database, job_handlers = self._app.database, self._app.job_handlers
        lost_after = timedelta(seconds=self._heartbeat.job_lost_after_s)
        kind = await asyncio.to_thread(jobs.claim, database, public_id, lost_after)
        if kind is None:
            return
        if kind not in job_handlers:
            raise LookupError(f"expected work among {', '.join(job_handlers)}, got {kind!r}")
        running = self._jobs.submit(
            public_id,
            jobs.run,
            (self._app.settings, public_id, job_handlers[kind]),
            partial(jobs.process_died, database, public_id),
        )
        if not await _uncancelled(running):
            await asyncio.to_thread(jobs.release, database, public_id)
            raise TaskReleasedError

    async def _run_logged(self, task: Job, doing: Coroutine[Any, Any, None]) -> None:
        """Run a task and log its end. If it fails for good, store the reason for the server."""
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
            jobs.fail(self._app.database, str(task.task_kwargs["argument"]), fault)


class _RetryStrategy(procrastinate.BaseRetryStrategy):
    def get_retry_decision(
        self, *, exception: BaseException, job: Job
    ) -> procrastinate.RetryDecision | None:
        return _decision(exception, job)


async def _uncancelled(work: Future[T]) -> T:
    """Await a future. Cancelling the caller leaves the work running, and its result is ignored."""
    done = asyncio.wrap_future(work)
    done.add_done_callback(lambda it: it.cancelled() or it.exception())
    return await asyncio.shield(done)


def _decision(error: BaseException, task: Job) -> procrastinate.RetryDecision | None:
    """When to retry a task after this error; None to fail it."""
    if isinstance(error, jobs.JobStillRunningError):
        return procrastinate.RetryDecision(retry_in={"seconds": _IN_HANDS_S})
    if isinstance(error, TaskReleasedError | asyncio.CancelledError):
        return procrastinate.RetryDecision(retry_in={"seconds": 0})
    # Temporary: the process was killed, for example by the OOM killer, or the database or the store
    # of recordings was away.
    passing = isinstance(error, BrokenProcessPool | OperationalError | StoreAwayError)
    if passing and task.attempts + 1 < MOST_LOSSES:
        return procrastinate.RetryDecision(retry_in={"seconds": _PASSES_S})
    return None


def _log_fields(task: Job) -> dict[str, object]:
    return {"task": task.task_name, "what": task.task_kwargs.get("argument")}
