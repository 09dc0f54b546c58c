"""Engine and transactions.

A read sees one consistent snapshot; a write takes its lock at the start, so that it cannot fail
half-way because somebody else wrote meanwhile.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import ExceptionContext, make_url
from sqlalchemy.exc import DataError
from sqlalchemy.exc import TimeoutError as WaitedTooLongError
from sqlalchemy.orm import Session, sessionmaker

from . import patience

#: How long a writer waits for another before it gives up, in milliseconds.
SQLITE_BUSY_TIMEOUT_MS = 15_000

#: How long emptying the write-ahead log may wait for those who read, in milliseconds.
SCRUB_TIMEOUT_MS = 2_000

#: Connections of one process to PostgreSQL at the most: its server lets in 100 from all by default.
POSTGRESQL_CONNECTIONS = 20

#: Execution option that marks a connection as one that will write.
_WRITES = "pbpo_writes"


class Database:
    """The door to one database. Hands out transactions, nothing else.

    `read()` and `write()` are context managers that yield an ORM session; leaving `write()`
    normally commits, leaving it by an exception rolls back. For who does not wait
    (`patience`), `write()` raises BusyError where SQLite has another writer.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.engine = _engine(url)
        self._writing = threading.Lock()
        self._impatient = _impatient_engine(url) if self.is_sqlite else self.engine
        self._readers = sessionmaker(_for_readers(self.engine), expire_on_commit=False)
        self._writers = _writers(self.engine)
        self._impatient_writers = _writers(self._impatient)

    @property
    def is_sqlite(self) -> bool:
        return self.engine.dialect.name == "sqlite"

    @property
    def answers_at_once(self) -> bool:
        """Whether no network lies between: all there is to wait for is another writer."""
        return self.is_sqlite

    @contextmanager
    def read(self) -> Iterator[Session]:
        with self._readers() as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        writers = self._impatient_writers if patience.is_lacking() else self._writers
        with self._in_turn(), writers.begin() as session:
            yield session

    @contextmanager
    def _in_turn(self) -> Iterator[None]:
        """One writer of this process after the other, where the database takes no two at once.

        SQLite has those who wait ask again after longer and longer pauses: of many, some would
        never have their turn. Raises SQLAlchemy's TimeoutError.
        """
        if not self.is_sqlite:
            yield
            return
        if not self._writing.acquire(blocking=False):
            if patience.is_lacking():
                raise patience.BusyError
            self._wait_for_turn()
        try:
            yield
        finally:
            self._writing.release()

    def _wait_for_turn(self) -> None:
        if not self._writing.acquire(timeout=SQLITE_BUSY_TIMEOUT_MS / 1000):
            raise WaitedTooLongError("the database was written to by others for too long")

    def scrub(self) -> None:
        """Take what was deleted off the disk, as far as the database leaves that to us.

        SQLite overwrites deleted rows with zeros, but its write-ahead log holds the pages as they
        were until it is emptied. PostgreSQL sees to its old rows itself.
        """
        if not self.is_sqlite:
            return
        with closing(self.engine.raw_connection()) as connection:
            cursor = connection.cursor()
            # Somebody who reads just now would be waited for: the next deletion, or the log's
            # own turn, does it then.
            cursor.execute(f"PRAGMA busy_timeout = {SCRUB_TIMEOUT_MS}")
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            cursor.execute(f"PRAGMA busy_timeout = {SQLITE_BUSY_TIMEOUT_MS}")
            cursor.close()

    def close(self) -> None:
        for engine in (self.engine, self._impatient):
            engine.dispose()


def _for_readers(engine: Engine) -> Engine:
    """The engine, where a transaction sees one moment: SQLite's does by itself."""
    if engine.dialect.name == "sqlite":
        return engine
    return engine.execution_options(isolation_level="REPEATABLE READ")


def _writers(engine: Engine) -> sessionmaker[Session]:
    return sessionmaker(engine.execution_options(**{_WRITES: True}), expire_on_commit=False)


def _engine(url: str) -> Engine:
    # Parameters stay out of error messages, which end in logs: they hold platforms' ids.
    if make_url(url).get_backend_name() != "sqlite":
        engine = create_engine(
            url,
            pool_size=POSTGRESQL_CONNECTIONS // 2,
            max_overflow=POSTGRESQL_CONNECTIONS // 2,
            # One that the server cut meanwhile is replaced, and nobody notices.
            pool_pre_ping=True,
            hide_parameters=True,
        )
        event.listen(engine, "handle_error", _not_storable)
        return engine
    # One connection per thread of the server's pool: a waiting reader never starves a response.
    engine = create_engine(url, pool_size=16, max_overflow=32, hide_parameters=True)
    event.listen(engine, "connect", _configure_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    event.listen(engine, "handle_error", _not_storable)
    return engine


def _impatient_engine(url: str) -> Engine:
    """Where another program writes, SQLite says so at once."""
    engine = _engine(url)
    event.listen(engine, "connect", _wait_for_nobody)
    event.listen(engine, "handle_error", _needs_patience)
    return engine


def _wait_for_nobody(connection: Any, _record: Any) -> None:
    connection.execute("PRAGMA busy_timeout = 0").close()


def _needs_patience(context: ExceptionContext) -> None:
    refused = context.original_exception
    if isinstance(refused, sqlite3.Error) and refused.sqlite_errorcode == sqlite3.SQLITE_BUSY:
        raise patience.BusyError from None


def _configure_sqlite(connection: Any, _record: Any) -> None:
    # The driver's own transactions start too late (at the first write): we begin them ourselves.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA busy_timeout = {SQLITE_BUSY_TIMEOUT_MS}")
    cursor.execute("PRAGMA journal_mode = WAL")
    # An acknowledged response must survive a power cut, so every commit reaches the disk.
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute("PRAGMA foreign_keys = ON")
    # What a person has had deleted must not be found in the file's free pages.
    cursor.execute("PRAGMA secure_delete = ON")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get(_WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _not_storable(context: ExceptionContext) -> None:
    """Drivers differ in how they refuse what no column can hold: here it is always a DataError."""
    refused = context.original_exception
    if isinstance(refused, OverflowError | UnicodeEncodeError):
        raise DataError(context.statement, None, refused, hide_parameters=True) from None
