"""The queue of tasks that servers leave to workers: what is asked for, and how far it is."""

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

#: What workers do, each kind in a queue of its own: nothing short waits behind what is long.
RENDER, JOB, RETENTION = "render", "job", "retention"
QUEUES = (RENDER, JOB, RETENTION)

#: How long a worker may say nothing before it is not counted, in seconds.
GONE_AFTER_S = 8.0

_STATUS = cast(TASKS.c.status, String)


@dataclass(frozen=True)
class Task:
    """One thing to do. Its `key` is its name's and its argument's: it waits at most once.

    priority: the higher, the sooner.
    """

    name: str
    argument: str
    priority: int = 0

    @property
    def key(self) -> str:
        return f"{self.name}:{self.argument}"


@dataclass(frozen=True)
class State:
    """How far a task is; `fault` says why it failed."""

    status: str
    fault: str | None


def procrastinate_connector(url: str) -> procrastinate.PsycopgConnector:
    """Procrastinate's connections to the database, which see its own schema alone."""
    return procrastinate.PsycopgConnector(
        conninfo=make_url(url).set(drivername="postgresql").render_as_string(hide_password=False),
        kwargs={"options": f"-c search_path={QUEUE_SCHEMA}", **keepalive_options(url)},
        min_size=1,
        max_size=4,
    )


class TaskQueue:
    """What servers ask of workers, and how far that is."""

    def __init__(self, database: Database) -> None:
        self._database = database
        # Never opened: what is asked for is written by our own connections.
        self._app = procrastinate.App(connector=procrastinate_connector(database.url))

    def enqueue(self, task: Task) -> int:
        """The id of the task, which is asked for unless it waits or runs already.

        One that waits for less is moved up.
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
                continue  # somebody else was quicker by a moment

    def states(self, ids: Collection[int]) -> Mapping[int, State]:
        """How far those tasks are that have not been done: what is done is in the queue no more."""
        with self._database.read() as db:
            rows = db.execute(
                select(TASKS.c.id, _STATUS, TASKS.c.args[FAULT].astext).where(TASKS.c.id.in_(ids))
            )
            return {row_id: State(status, fault) for row_id, status, fault in rows}

    def note_fault(self, task_id: int, fault: str) -> None:
        """Let whoever waits for the task know why it fails."""
        with writing(self._database) as session:
            session.execute(
                update(TASKS)
                .where(TASKS.c.id == task_id)
                .values(args=TASKS.c.args.concat(func.jsonb_build_object(FAULT, fault)))
            )

    def requeue_stalled(self, silent_s: float, most: int) -> list[StalledTask]:
        """Let tasks of lost workers wait again: see `lost_tasks`."""
        with writing(self._database) as session:
            return requeue_stalled(session, silent_s, most)

    def count(self, name: str) -> tuple[int, int]:
        """How many tasks of this name wait, and how many run."""
        with self._database.read() as db:
            rows = db.execute(
                select(_STATUS, func.count())
                .where(TASKS.c.task_name == name, is_in(WAITING) | is_in(RUNNING))
                .group_by(_STATUS)
            )
            found = {str(status): int(number) for status, number in rows}
        return found.get(WAITING, 0), found.get(RUNNING, 0)

    def workers(self) -> int:
        """How many workers were heard of just now. Each is registered once for each queue."""
        since = func.now() - timedelta(seconds=GONE_AFTER_S)
        with self._database.read() as db:
            registered = db.scalar(
                select(func.count()).select_from(WORKERS).where(WORKERS.c.last_heartbeat > since)
            )
        return (registered or 0) // len(QUEUES)


def _under_way(db: Session, task: Task) -> int | None:
    """The id of the task if it waits, moved up as far as it now has to be, or if it runs."""
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
