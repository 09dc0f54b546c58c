"""Engine and transactions.

A reading transaction sees one consistent snapshot. A writing transaction on SQLite takes the write
lock at its start (BEGIN IMMEDIATE), so that it cannot fail later because of another writer.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import ExceptionContext, make_url
from sqlalchemy.exc import DataError
from sqlalchemy.exc import TimeoutError as WaitedTooLongError
from sqlalchemy.orm import Session, sessionmaker

from . import integrity_errors
from .commit import commit

#: Timeout of a writer that waits for another one, in milliseconds.
SQLITE_BUSY_TIMEOUT_MS = 15_000

#: Timeout of the WAL checkpoint that waits for readers, in milliseconds.
SCRUB_TIMEOUT_MS = 2_000

#: Connections of one process to PostgreSQL at the most: a server allows 100 in total by default.
POSTGRESQL_CONNECTIONS = 20

#: libpq's connect and keepalive options, by which a vanished PostgreSQL server is detected within
#: half a minute; by the system's defaults, a quarter of an hour. Options in the URL override these.
_KEEPALIVE = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 20_000,
}

#: Execution option that marks a connection as one that will write.
_WRITES = "pbpo_writes"


class Database:
    """Transactions of one database.

    `read()` and `write()` are context managers that yield an ORM session. `read()` sees one
    snapshot. Leaving `write()` normally commits, leaving it by an exception rolls back; it raises
    CommitLostError if the connection drops during the commit.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.engine = _engine(url)
        self._writer_lock = threading.Lock()
        # SQLite reads from one snapshot by itself.
        snapshot = {} if self.is_sqlite else {"isolation_level": "REPEATABLE READ"}
        self._readers = sessionmaker(
            self.engine.execution_options(**snapshot), expire_on_commit=False
        )
        self._writers = sessionmaker(
            self.engine.execution_options(**{_WRITES: True}), expire_on_commit=False
        )

    @property
    def is_sqlite(self) -> bool:
        """Whether the database is SQLite; otherwise it is PostgreSQL."""
        return self.engine.dialect.name == "sqlite"

    @contextmanager
    def read(self) -> Iterator[Session]:
        """A reading transaction on one snapshot."""
        with self._readers() as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """A writing transaction: commits at the end, rolls back on an exception."""
        with self._writer_turn(), self._writers() as session:
            yield session
            session.flush()
            commit(session)

    def is_writing(self, db: Session) -> bool:
        """Whether this ORM session is one of `write()`."""
        engine = db.get_bind()
        return bool(engine.get_execution_options().get(_WRITES, False))

    @contextmanager
    def _writer_turn(self) -> Iterator[None]:
        """Serialise the writers of this process on SQLite, which takes one at a time.

        SQLite's own busy handler retries after growing pauses, which would starve some of many
        waiting writers. Raises SQLAlchemy's TimeoutError.
        """
        if not self.is_sqlite:
            yield
            return
        if not self._writer_lock.acquire(timeout=SQLITE_BUSY_TIMEOUT_MS / 1000):
            raise WaitedTooLongError("the database was written to by others for too long")
        try:
            yield
        finally:
            self._writer_lock.release()

    def scrub(self) -> None:
        """Truncate SQLite's write-ahead log, which still contains deleted rows.

        In the database file SQLite overwrites deleted rows with zeros (secure_delete). A no-op on
        PostgreSQL, which vacuums old rows itself.
        """
        if not self.is_sqlite:
            return
        with closing(self.engine.raw_connection()) as connection:
            cursor = connection.cursor()
            # A reader can block the checkpoint. After the timeout it is left to the next deletion
            # or to SQLite's automatic checkpoint.
            cursor.execute(f"PRAGMA busy_timeout = {SCRUB_TIMEOUT_MS}")
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            cursor.execute(f"PRAGMA busy_timeout = {SQLITE_BUSY_TIMEOUT_MS}")
            cursor.close()

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


def _engine(url: str) -> Engine:
    # Parameters are hidden in error messages, which are logged: they may be ids of platforms.
    if make_url(url).get_backend_name() != "sqlite":
        engine = create_engine(
            url,
            pool_size=POSTGRESQL_CONNECTIONS // 2,
            max_overflow=POSTGRESQL_CONNECTIONS // 2,
            # Replace connections that the server has closed in the meantime.
            pool_pre_ping=True,
            connect_args=keepalive_options(url),
            hide_parameters=True,
        )
        event.listen(engine, "handle_error", _not_storable)
        event.listen(engine, "handle_error", integrity_errors.redact_parameters)
        return engine
    # One connection per thread of the server's pool, so that readers never block a response.
    engine = create_engine(url, pool_size=16, max_overflow=32, hide_parameters=True)
    event.listen(engine, "connect", _configure_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    event.listen(engine, "handle_error", _not_storable)
    return engine


def keepalive_options(url: str) -> dict[str, int]:
    """The connect and keepalive options for libpq that the URL does not set itself."""
    own = make_url(url).query
    return {name: value for name, value in _KEEPALIVE.items() if name not in own}


def _configure_sqlite(connection: Any, _record: Any) -> None:
    # The driver would begin transactions at the first write only; `_begin_sqlite` begins them.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA busy_timeout = {SQLITE_BUSY_TIMEOUT_MS}")
    cursor.execute("PRAGMA journal_mode = WAL")
    # An acknowledged response must survive a power cut, so every commit reaches the disk.
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute("PRAGMA foreign_keys = ON")
    # Overwrite deleted rows with zeros, so that free pages of the file contain no deleted data.
    cursor.execute("PRAGMA secure_delete = ON")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get(_WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _not_storable(context: ExceptionContext) -> None:
    """Raise DataError for values that no column can hold; drivers raise different errors."""
    refused = context.original_exception
    if isinstance(refused, OverflowError | UnicodeEncodeError):
        raise DataError(context.statement, None, refused, hide_parameters=True) from None
