"""The queue of tasks that servers leave to workers: Procrastinate's, in a schema of its own.

Its tables lie apart from ours: no migration, no count of rows and no backup has them. Nothing in
them has to outlive anything: what is lost is asked for again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import procrastinate
from procrastinate.exceptions import AlreadyEnqueued
from procrastinate.schema import SchemaManager
from sqlalchemy import (
    Integer,
    String,
    cast,
    column,
    func,
    literal_column,
    select,
    table,
    text,
    update,
)
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session

from .alone import Alone
from .database import Database
from .dumps import QUEUE_SCHEMA as SCHEMA

#: Its schema follows its version: another one's queue is made anew.
_VERSION = f"procrastinate {procrastinate.__version__}"

WAITING, RUNNING = "todo", "doing"

#: What workers do, each kind in a queue of its own: nothing short waits behind what is long.
RENDER, JOB, RETENTION = "render", "job", "retention"
QUEUES = (RENDER, JOB, RETENTION)

#: How long a worker may say nothing before it is not counted, in seconds.
GONE_AFTER_S = 8.0

#: Where it is noted, among a task's own arguments, why it failed, and how often it was lost.
_FAULT, _LOST = "fault", "lost"

_JOBS = table(
    "procrastinate_jobs",
    column("id", Integer),
    column("task_name", String),
    column("priority", Integer),
    column("queueing_lock", String),
    column("args", JSONB),
    column("status", String),
    schema=SCHEMA,
)
_WORKERS = table("procrastinate_workers", column("last_heartbeat"), schema=SCHEMA)
_STATUS = cast(_JOBS.c.status, String)
# As literals: compared as text, the tables' own indices would be of no use.
_WAITS = _JOBS.c.status == literal_column(f"'{WAITING}'")
_RUNS = _JOBS.c.status == literal_column(f"'{RUNNING}'")


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


def connector_of(url: str) -> procrastinate.PsycopgConnector:
    """Procrastinate's connections to the database, which see its own schema alone."""
    return procrastinate.PsycopgConnector(
        conninfo=make_url(url).set(drivername="postgresql").render_as_string(hide_password=False),
        kwargs={"options": f"-c search_path={SCHEMA}"},
        min_size=1,
        max_size=4,
    )


def prepare(database: Database) -> None:
    """Make the queue where it is missing, or of another version; others wait, and find it done."""
    with database.write() as session:
        session.execute(text("SELECT pg_advisory_xact_lock(:what)"), {"what": Alone.MIGRATION})
        there = session.scalar(
            text("SELECT obj_description(to_regnamespace(:name), 'pg_namespace')"), {"name": SCHEMA}
        )
        if there == _VERSION:
            return
        for statement in (
            f"DROP SCHEMA IF EXISTS {SCHEMA} CASCADE",
            f"CREATE SCHEMA {SCHEMA}",
            f"COMMENT ON SCHEMA {SCHEMA} IS '{_VERSION}'",
            f"SET LOCAL search_path TO {SCHEMA}",
        ):
            session.execute(text(statement))
        session.connection().exec_driver_sql(SchemaManager.get_schema().replace("%", "%%"))


class TaskQueue:
    """What servers ask of workers, and how far that is."""

    def __init__(self, database: Database) -> None:
        self._database = database
        # Never opened: what is asked for is written by our own connections.
        self._app = procrastinate.App(connector=connector_of(database.url))

    def ask(self, task: Task) -> int:
        """The id of the task, which is asked for unless it waits or runs already.

        One that waits for less is moved up.
        """
        while True:
            with self._database.write() as session:
                under_way = _under_way(session, task)
            if under_way is not None:
                return under_way
            try:
                with self._database.write() as session:
                    session.execute(text(f"SET LOCAL search_path TO {SCHEMA}"))
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
        with self._database.read() as session:
            rows = session.execute(
                select(_JOBS.c.id, _STATUS, _JOBS.c.args[_FAULT].astext).where(_JOBS.c.id.in_(ids))
            )
            return {row_id: State(status, fault) for row_id, status, fault in rows}

    def note_fault(self, task_id: int, fault: str) -> None:
        """Let whoever waits for the task know why it fails."""
        with self._database.write() as session:
            session.execute(
                update(_JOBS)
                .where(_JOBS.c.id == task_id)
                .values(args=_JOBS.c.args.concat(func.jsonb_build_object(_FAULT, fault)))
            )

    def note_loss(self, task_id: int) -> int:
        """Note that the worker was lost that had the task in hand; how often that has happened."""
        lost = func.coalesce(_JOBS.c.args[_LOST].astext, "0").cast(Integer) + 1
        with self._database.write() as session:
            noted = session.scalar(
                update(_JOBS)
                .where(_JOBS.c.id == task_id)
                .values(args=_JOBS.c.args.concat(func.jsonb_build_object(_LOST, lost)))
                .returning(_JOBS.c.args[_LOST].astext)
            )
        return int(noted or 0)

    def count(self, name: str) -> tuple[int, int]:
        """How many tasks of this name wait, and how many run."""
        with self._database.read() as session:
            rows = session.execute(
                select(_STATUS, func.count())
                .where(_JOBS.c.task_name == name, _WAITS | _RUNS)
                .group_by(_STATUS)
            )
            found = {str(status): int(number) for status, number in rows}
        return found.get(WAITING, 0), found.get(RUNNING, 0)

    def workers(self) -> int:
        """How many workers were heard of just now. Each is registered once for each queue."""
        since = func.now() - text(f"interval '{GONE_AFTER_S} seconds'")
        with self._database.read() as session:
            registered = session.scalar(
                select(func.count()).select_from(_WORKERS).where(_WORKERS.c.last_heartbeat > since)
            )
        return (registered or 0) // len(QUEUES)


def _under_way(session: Session, task: Task) -> int | None:
    """The id of the task if it waits, moved up as far as it now has to be, or if it runs."""
    moved_up = session.scalar(
        update(_JOBS)
        .where(_JOBS.c.queueing_lock == task.key, _WAITS)
        .values(priority=func.greatest(_JOBS.c.priority, task.priority))
        .returning(_JOBS.c.id)
    )
    if moved_up is not None:
        return int(moved_up)
    running = session.scalar(select(_JOBS.c.id).where(_JOBS.c.queueing_lock == task.key, _RUNS))
    return None if running is None else int(running)
