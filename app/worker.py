"""A worker: a process that does what servers leave to it, until a signal says stop."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import procrastinate

from app.services.background.local import LocalBackground
from app.services.bootstrap import open_app
from app.services.maintenance import periodic_tasks
from app.services.maintenance.worker_tasks import HeartbeatConfig, WorkerTasks
from app.services.monitoring import startup_checks
from app.services.rollouts import crane_machine
from app.services.runtime import json_logging
from app.services.runtime.settings import Settings
from app.storage.task_queue import QUEUES, RENDER, TaskQueue

from .simulation import JOBS

log = logging.getLogger(__name__)

#: How often a worker looks for tasks that nobody calls it for, since they were given back: seconds.
_LOOK_S = 1.0
#: Between two tries to reach the database, in seconds.
_TRY_AGAIN_S = 2.0


def work(
    settings: Settings,
    videos: int,
    ready: Callable[[], None],
    *,
    alive: Path | None = None,
    heartbeat: HeartbeatConfig = HeartbeatConfig(),  # noqa: B008 - a frozen value
) -> None:
    """Do what servers ask for, so many videos at a time, until SIGTERM or SIGINT.

    ready: called once it takes tasks. alive: a file that is touched as long as it reaches the
    database. Logs are lines of JSON. Raises ConflictError without the setting.
    """
    startup_checks.require_workers_apart(settings)
    json_logging.write_json()
    logging.getLogger("procrastinate").setLevel(logging.WARNING)
    # It tells of each task that failed, and so do we.
    logging.getLogger("procrastinate.worker").setLevel(logging.CRITICAL)
    for queue in QUEUES:
        logging.getLogger(f"procrastinate.worker.{queue}").setLevel(logging.WARNING)
    app = open_app(settings, background=LocalBackground(videos), job_handlers=JOBS)
    try:
        tasks = WorkerTasks(app, TaskQueue(app.database), heartbeat)
        with periodic_tasks.running(app, of_the_studio=False), crane_machine.running(app):
            asyncio.run(_until_told(tasks, _Manner(videos, alive, heartbeat), ready))
    finally:
        app.close()


@dataclass(frozen=True)
class _Manner:
    """So many videos at a time, a file that says that it lives, and how often."""

    videos: int
    alive: Path | None
    heartbeat: HeartbeatConfig


async def _until_told(tasks: WorkerTasks, manner: _Manner, ready: Callable[[], None]) -> None:
    told = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, told.set)
    is_ready = False
    while not told.is_set():
        try:
            async with tasks.app().open_async() as queue_app:
                await asyncio.to_thread(tasks.enqueue_retention)
                if not is_ready:
                    ready()
                    is_ready = True
                await _take_tasks(queue_app, tasks, manner, told)
        except Exception:
            # The database was stopped, say: what was in hand is taken back by whoever is there.
            log.exception("the worker lost its queue, and tries again")
        if not told.is_set():
            await _wait(told, _TRY_AGAIN_S)


async def _take_tasks(
    queue_app: procrastinate.App, tasks: WorkerTasks, manner: _Manner, told: asyncio.Event
) -> None:
    """Take tasks until told to stop, or until the queue cannot be reached."""
    heartbeat = manner.heartbeat
    hands = [
        asyncio.create_task(
            queue_app.run_worker_async(
                queues=[queue],
                name=queue,
                concurrency=manner.videos if queue == RENDER else 1,
                fetch_job_polling_interval=_LOOK_S,
                # Meanwhile it is not heard of: who finishes for longer is given up.
                shutdown_graceful_timeout=heartbeat.gone_after_s / 2,
                delete_jobs="successful",
                install_signal_handlers=False,
                update_heartbeat_interval=heartbeat.beat_s,
                stalled_worker_timeout=heartbeat.gone_after_s,
            )
        )
        for queue in QUEUES
    ]
    others = [
        asyncio.create_task(_keep_watch(tasks, manner)),
        asyncio.create_task(told.wait()),
    ]
    await asyncio.wait([*hands, *others], return_when=asyncio.FIRST_COMPLETED)
    for one in (*hands, *others):
        one.cancel()
    if told.is_set():
        # Once nothing new is taken: a job that is given back is another worker's.
        await asyncio.sleep(0)
        await asyncio.to_thread(tasks.stop)
    ended = await asyncio.gather(*hands, *others, return_exceptions=True)
    for error in ended:
        if isinstance(error, Exception):
            raise error


async def _keep_watch(tasks: WorkerTasks, manner: _Manner) -> None:
    while True:
        await asyncio.to_thread(tasks.requeue_stalled)
        if manner.alive is not None:
            manner.alive.touch()
        await asyncio.sleep(manner.heartbeat.beat_s)


async def _wait(told: asyncio.Event, seconds: float) -> None:
    try:
        await asyncio.wait_for(told.wait(), seconds)
    except TimeoutError:
        return
