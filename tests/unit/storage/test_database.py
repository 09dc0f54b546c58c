"""Transactions: all or nothing, a steady view for readers, one writer after the other."""

from __future__ import annotations

import threading
import time
from datetime import UTC, datetime
from typing import Any

import pytest
from sqlalchemy import Connection, Engine, create_engine, event, func, select, text
from sqlalchemy.exc import DataError

from app.services.context import AppContext
from app.storage import database as doors
from app.storage.commit import CommitLostError
from app.storage.database import Database
from app.storage.models.studies import Study
from app.storage.task_queue import procrastinate_connector


def study(slug: str) -> Study:
    return Study(slug=slug, status="draft", created_at=datetime(2026, 3, 1, tzinfo=UTC))


def count(database: Database) -> int:
    with database.read() as db:
        return db.scalar(select(func.count(Study.id))) or 0


def test_a_write_that_fails_leaves_nothing(app: AppContext) -> None:
    def write() -> None:
        with app.database.write() as db:
            db.add(study("a"))
            db.flush()
            raise RuntimeError("half-way")

    with pytest.raises(RuntimeError, match="half-way"):
        write()
    assert count(app.database) == 0


def test_a_reader_sees_what_was_there_when_it_began(app: AppContext) -> None:
    statement = select(func.count(Study.id))
    with app.database.read() as reader:
        assert reader.scalar(statement) == 0
        with app.database.write() as db:
            db.add(study("a"))
        assert reader.scalar(statement) == 0
    assert count(app.database) == 1


@pytest.mark.sqlite
def test_a_writer_waits_for_the_one_before_instead_of_failing(app: AppContext) -> None:
    first_is_in = threading.Event()

    def write_slowly() -> None:
        with app.database.write() as db:
            db.add(study("first"))
            db.flush()
            first_is_in.set()
            time.sleep(0.1)

    thread = threading.Thread(target=write_slowly)
    thread.start()
    first_is_in.wait(5)
    # It reads before it writes: a lock that came only with the write would be refused here.
    with app.database.write() as db:
        assert db.scalar(select(func.count(Study.id))) == 1
        db.add(study("second"))
    thread.join()
    assert count(app.database) == 2


@pytest.mark.sqlite
@pytest.mark.parametrize(
    ("pragma", "value"), [("synchronous", 2), ("foreign_keys", 1), ("journal_mode", "wal")]
)
def test_what_is_acknowledged_is_on_the_disk(
    app: AppContext, pragma: str, value: int | str
) -> None:
    with app.database.read() as db:
        assert db.scalar(text(f"PRAGMA {pragma}")) == value


@pytest.mark.parametrize("value", [10**19, "\ud800"])
def test_what_no_column_can_hold_is_refused_alike_by_every_database(
    app: AppContext, value: int | str
) -> None:
    column = Study.id if isinstance(value, int) else Study.slug
    with app.database.read() as db, pytest.raises(DataError):
        db.scalar(select(Study.id).where(column == value))


@pytest.mark.postgresql
def test_a_connection_that_is_cut_during_the_commit_leaves_the_outcome_unknown(
    app: AppContext,
) -> None:
    def cut(connection: Connection) -> None:
        driver: Any = connection.connection.dbapi_connection
        pid = driver.info.backend_pid
        with app.database.read() as other:
            other.execute(select(func.pg_terminate_backend(pid, 5_000)))

    database = Database(app.settings.url)
    event.listen(database.engine, "commit", cut)
    with pytest.raises(CommitLostError), database.write() as db:
        db.add(study("a"))
    database.close()


def test_every_connection_to_postgresql_is_told_when_its_server_is_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[dict[str, Any]] = []

    def making(url: str, **options: Any) -> Engine:
        asked.append(options["connect_args"])
        return create_engine(url, **options)

    monkeypatch.setattr(doors, "create_engine", making)
    url = "postgresql+psycopg://somebody@nowhere.example/studio?keepalives_idle=60"
    Database(url).close()
    # The server's connections, and those of workers to their queue.
    asked.append(procrastinate_connector(url)._pool_args["kwargs"])
    assert len(asked) == 2
    for one in asked:
        assert (one["connect_timeout"], one["tcp_user_timeout"]) == (10, 20_000)
        # What the URL says goes first.
        assert "keepalives_idle" not in one
