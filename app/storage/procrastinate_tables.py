"""The tables of Procrastinate's queue, in a schema of their own, as far as we read or write them.

They lie apart from ours: no migration, no count of rows and no backup has them. Nothing in them has
to outlive anything: what is lost is asked for again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import procrastinate
from procrastinate.schema import SchemaManager
from sqlalchemy import (
    ColumnElement,
    FromClause,
    Integer,
    String,
    column,
    literal_column,
    table,
    text,
)
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.orm import Session

from .advisory_lock import AdvisoryLock
from .database import Database
from .dump_restore import QUEUE_SCHEMA

#: Its schema follows its version: another one's queue is made anew.
_VERSION = f"procrastinate {procrastinate.__version__}"

#: States of a task; one that is done is in the queue no more.
WAITING, RUNNING, FAILED = "todo", "doing", "failed"

#: Where it is noted, among a task's own arguments, why it failed, and how often it was lost.
FAULT, LOST = "fault", "lost"

TASKS = table(
    "procrastinate_jobs",
    column("id", Integer),
    column("task_name", String),
    column("priority", Integer),
    column("queueing_lock", String),
    column("args", JSONB),
    column("status", String),
    column("attempts", Integer),
    column("worker_id", Integer),
    schema=QUEUE_SCHEMA,
)
WORKERS = table(
    "procrastinate_workers", column("id", Integer), column("last_heartbeat"), schema=QUEUE_SCHEMA
)


def is_in(status: str, tasks: FromClause = TASKS) -> ColumnElement[bool]:
    """Whether a task is in this state; as a literal, for which the tables have indices."""
    return tasks.c.status == literal_column(f"'{status}'")


@contextmanager
def writing(database: Database) -> Iterator[Session]:
    """A transaction in which the queue's own functions and triggers find its tables."""
    with database.write() as db:
        db.execute(text(f"SET LOCAL search_path TO {QUEUE_SCHEMA}"))
        yield db


def prepare(database: Database) -> None:
    """Make the queue where it is missing, or of another version; others wait, and find it done."""
    with database.write() as db:
        db.execute(text("SELECT pg_advisory_xact_lock(:what)"), {"what": AdvisoryLock.MIGRATION})
        there = db.scalar(
            text("SELECT obj_description(to_regnamespace(:name), 'pg_namespace')"),
            {"name": QUEUE_SCHEMA},
        )
        if there == _VERSION:
            return
        for statement in (
            f"DROP SCHEMA IF EXISTS {QUEUE_SCHEMA} CASCADE",
            f"CREATE SCHEMA {QUEUE_SCHEMA}",
            f"COMMENT ON SCHEMA {QUEUE_SCHEMA} IS '{_VERSION}'",
            f"SET LOCAL search_path TO {QUEUE_SCHEMA}",
        ):
            db.execute(text(statement))
        db.connection().exec_driver_sql(SchemaManager.get_schema().replace("%", "%%"))
