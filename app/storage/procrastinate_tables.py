"""The tables of Procrastinate's queue that we read or write, in a PostgreSQL schema of their own.

Migrations and backups do not include them. Their content is expendable: lost tasks are enqueued
again.
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

#: Comment on the schema. The queue is recreated if it was made by another version of Procrastinate.
_VERSION = f"procrastinate {procrastinate.__version__}"

#: States of a task; finished tasks are deleted.
WAITING, RUNNING, FAILED = "todo", "doing", "failed"

#: Keys among a task's arguments: why it failed, and how many workers were lost while running it.
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
    """The condition that a task is in this state, as a literal, so that partial indices apply."""
    return tasks.c.status == literal_column(f"'{status}'")


@contextmanager
def writing(database: Database) -> Iterator[Session]:
    """A writing transaction with the queue's schema as search path, which its functions need."""
    with database.write() as db:
        db.execute(text(f"SET LOCAL search_path TO {QUEUE_SCHEMA}"))
        yield db


def prepare(database: Database) -> None:
    """Create the queue's schema unless it exists in this version. Concurrent calls wait."""
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
