"""Client of the task queue (Procrastinate): enqueues tasks for workers and polls their state."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import timedelta

import procrastinate
from procrastinate.exceptions import AlreadyEnqueued
from sqlalchemy import String, cast, func, select, update
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session

from .database import Database, keepalive_options
from .dump_restore import QUEUE_SCHEMA
from .procrastinate_tables import FAULT, RUNNING, TASKS, WAITING, WORKERS, is_in, writing
from .stalled_tasks import StalledTask, requeue_stalled

#: Names of the tasks. Each has a queue of its own, so that short tasks do not wait for long ones.
RENDER, JOB, RETENTION = "render", "job", "retention"
QUEUES = (RENDER, JOB, RETENTION)

#: A worker without a heartbeat for so many seconds is not counted.
GONE_AFTER_S = 8.0

_STATUS = cast(TASKS.c.status, String)


@dataclass(frozen=True)
class Task:
    """One task. Tasks of the same name and argument have the same key, and are queued once.

    priority: tasks with a higher one are run first.
    """

    name: str
    argument: str
    priority: int = 0

    @property
    def key(self) -> str:
        """Identifies the task in the queue."""
        return f"{self.name}:{self.argument}"


@dataclass(frozen=True)
class State:
    """The state of a task. fault: why it failed."""

    status: str
    fault: str | None


def procrastinate_connector(url: str) -> procrastinate.PsycopgConnector:
    """Procrastinate's connection pool, with its own schema as search path."""
    return procrastinate.PsycopgConnector(
        conninfo=make_url(url).set(drivername="postgresql").render_as_string(hide_password=False),
        kwargs={"options": f"-c search_path={QUEUE_SCHEMA}", **keepalive_options(url)},
        min_size=1,
        max_size=4,
    )


class TaskQueue:
    """Enqueues tasks, reads their state, and recovers those of lost workers."""

    def __init__(self, database: Database) -> None:
        self._database = database
        # Its connector is never opened: tasks are written by our own connections.
        self._app = procrastinate.App(connector=procrastinate_connector(database.url))

    def enqueue(self, task: Task) -> int:
        """Enqueue the task unless it is waiting or running, and return its id.

        A waiting task with a lower priority gets this one.
        """
        while True:
            with writing(self._database) as session:
                under_way = _under_way(session, task)
            if under_way is not None:
                return under_way
            try:
                with writing(self._database) as session:
                    return self._app.configure_task(
                        task.name,
                        queue=task.name,
                        priority=task.priority,
                        lock=task.key,
                        queueing_lock=task.key,
                        connection=session.connection().connection.driver_connection,
                    ).defer(argument=task.argument)
            except AlreadyEnqueued:
                continue  # enqueued concurrently by another process

    def states(self, ids: Collection[int]) -> Mapping[int, State]:
        """States of these tasks by id. Finished tasks are deleted and have no entry."""
        with self._database.read() as db:
            rows = db.execute(
                select(TASKS.c.id, _STATUS, TASKS.c.args[FAULT].astext).where(TASKS.c.id.in_(ids))
            )
            return {row_id: State(status, fault) for row_id, status, fault in rows}

    def note_fault(self, task_id: int, fault: str) -> None:
        """Store why the task failed, for the server that waits for it."""
        with writing(self._database) as session:
            session.execute(
                update(TASKS)
                .where(TASKS.c.id == task_id)
                .values(args=TASKS.c.args.concat(func.jsonb_build_object(FAULT, fault)))
            )

    def requeue_stalled(self, silent_s: float, most: int) -> list[StalledTask]:
        """Requeue tasks of lost workers: see `stalled_tasks.requeue_stalled`."""
        with writing(self._database) as session:
            return requeue_stalled(session, silent_s, most)

    def count(self, name: str) -> tuple[int, int]:
        """Numbers of waiting and of running tasks of this name."""
        with self._database.read() as db:
            rows = db.execute(
                select(_STATUS, func.count())
                .where(TASKS.c.task_name == name, is_in(WAITING) | is_in(RUNNING))
                .group_by(_STATUS)
            )
            found = {str(status): int(number) for status, number in rows}
        return found.get(WAITING, 0), found.get(RUNNING, 0)

    def workers(self) -> int:
        """Number of workers with a recent heartbeat."""
        since = func.now() - timedelta(seconds=GONE_AFTER_S)
        with self._database.read() as db:
            registered = db.scalar(
                select(func.count()).select_from(WORKERS).where(WORKERS.c.last_heartbeat > since)
            )
        # Each worker registers once for each queue.
        return (registered or 0) // len(QUEUES)


def _under_way(db: Session, task: Task) -> int | None:
    """The id of the task if it is waiting (its priority is raised if needed) or running."""
    moved_up = db.scalar(
        update(TASKS)
        .where(TASKS.c.queueing_lock == task.key, is_in(WAITING))
        .values(priority=func.greatest(TASKS.c.priority, task.priority))
        .returning(TASKS.c.id)
    )
    if moved_up is not None:
        return int(moved_up)
    running = db.scalar(select(TASKS.c.id).where(TASKS.c.queueing_lock == task.key, is_in(RUNNING)))
    return None if running is None else int(running)
