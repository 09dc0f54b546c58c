"""Engine and transactions.

A read sees one consistent snapshot; a write takes its lock at the start, so that it cannot fail
half-way because somebody else wrote meanwhile.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Self

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import ExceptionContext, make_url
from sqlalchemy.exc import DataError
from sqlalchemy.exc import TimeoutError as WaitedTooLongError
from sqlalchemy.orm import Session, sessionmaker

from . import clashes, patience
from .commits import commit
from .impatient import Impatient

#: How long a writer waits for another before it gives up, in milliseconds.
SQLITE_BUSY_TIMEOUT_MS = 15_000

#: How long emptying the write-ahead log may wait for those who read, in milliseconds.
SCRUB_TIMEOUT_MS = 2_000

#: Connections of one process to PostgreSQL at the most: its server lets in 100 from all by default.
POSTGRESQL_CONNECTIONS = 20
#: Of these, connections of the server's event loop, which does not wait: one read within a write.
_HURRIED = 2

#: When a PostgreSQL server is given up whose machine or network is gone, in libpq's terms; the
#: system would wait for a quarter of an hour. What the URL says of them goes first.
_GIVEN_UP = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 20_000,
}

#: Execution option that marks a connection as one that will write.
_WRITES = "pbpo_writes"


@dataclass(frozen=True)
class _Sessions:
    """Of one engine: of those who read, and of those who write."""

    of_readers: sessionmaker[Session]
    of_writers: sessionmaker[Session]

    @classmethod
    def on(cls, engine: Engine) -> Self:
        # Who reads sees one moment: on SQLite by itself.
        is_sqlite = engine.dialect.name == "sqlite"
        steady = {} if is_sqlite else {"isolation_level": "REPEATABLE READ"}
        return cls(
            sessionmaker(engine.execution_options(**steady), expire_on_commit=False),
            sessionmaker(engine.execution_options(**{_WRITES: True}), expire_on_commit=False),
        )


class Database:
    """The door to one database. Hands out transactions, nothing else.

    `read()` and `write()` are context managers that yield an ORM session; leaving `write()`
    normally commits, leaving it by an exception rolls back; where a server is lost in the middle of
    that, it raises CommitLostError. For who does not wait (`patience`), both raise
    NeedsPatienceError where they would: BusyError where somebody else writes.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.engine = _engine(url)
        self._writing = threading.Lock()
        self._patient = _Sessions.on(self.engine)
        self._impatient = Impatient(_impatient_engine(url), _HURRIED)
        self._hurried = _Sessions.on(self._impatient.engine)

    @property
    def is_sqlite(self) -> bool:
        return self.engine.dialect.name == "sqlite"

    @property
    def answers_at_once(self) -> bool:
        """Whether who does not wait need not even ask for patience, most likely."""
        return self._impatient.is_asked

    @contextmanager
    def read(self) -> Iterator[Session]:
        with self._asked(self._sessions().of_readers()) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        with self._in_turn(), self._asked(self._sessions().of_writers()) as session:
            yield session
            session.flush()
            commit(session)

    def _sessions(self) -> _Sessions:
        return self._hurried if patience.is_lacking() else self._patient

    @contextmanager
    def _asked(self, session: Session) -> Iterator[Session]:
        if patience.is_lacking():
            with session, self._impatient.asked(session):
                try:
                    yield session
                finally:
                    # Here and not when it is closed: the server is asked for that, too.
                    session.rollback()
        else:
            with session:
                yield session
            self._impatient.answered()

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
        for engine in (self.engine, self._impatient.engine):
            engine.dispose()


def _engine(url: str) -> Engine:
    # Parameters stay out of error messages, which end in logs: they hold platforms' ids.
    if make_url(url).get_backend_name() != "sqlite":
        engine = create_engine(
            url,
            pool_size=(POSTGRESQL_CONNECTIONS - _HURRIED) // 2,
            max_overflow=(POSTGRESQL_CONNECTIONS - _HURRIED) // 2,
            # One that the server cut meanwhile is replaced, and nobody notices.
            pool_pre_ping=True,
            connect_args=given_up(url),
            hide_parameters=True,
        )
        event.listen(engine, "handle_error", _not_storable)
        event.listen(engine, "handle_error", clashes.leave_out_the_row)
        return engine
    # One connection per thread of the server's pool: a waiting reader never starves a response.
    engine = create_engine(url, pool_size=16, max_overflow=32, hide_parameters=True)
    event.listen(engine, "connect", _configure_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    event.listen(engine, "handle_error", _not_storable)
    return engine


def _impatient_engine(url: str) -> Engine:
    if make_url(url).get_backend_name() == "sqlite":
        return _engine(url)
    engine = create_engine(
        url,
        pool_size=_HURRIED,
        pool_use_lifo=True,
        # It has nobody beside it to wait for. One that was cut meanwhile is no loss: who waits asks
        # again.
        max_overflow=-1,
        connect_args=given_up(url),
        hide_parameters=True,
    )
    event.listen(engine, "handle_error", _not_storable)
    event.listen(engine, "handle_error", clashes.leave_out_the_row)
    return engine


def given_up(url: str) -> dict[str, int]:
    """With which a connection to PostgreSQL is told when its server is gone."""
    own = make_url(url).query
    return {name: value for name, value in _GIVEN_UP.items() if name not in own}


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
