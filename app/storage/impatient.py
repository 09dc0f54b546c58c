"""Connections of who does not wait (`patience`): every wait of theirs ends after milliseconds.

SQLite is at hand, and there is only another writer to wait for. PostgreSQL's server may be far
away, slow, stopped or silent. So it is somebody who can wait that opens the connections, in a
thread; and where one of them fails, who does not wait lets the server be for a while.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

from sqlalchemy import Connection, Engine, event
from sqlalchemy.exc import DBAPIError, OperationalError
from sqlalchemy.orm import Session

from . import patience
from .commits import CommitLostError

#: The longest way to a server that is near, there and back, in seconds: a response goes it about
#: ten times. It is gone so often to find its length.
NEAR_S = 0.002
TRIPS: Final = 10

#: For how long a row that another holds is waited for, and a statement's answer, in milliseconds.
LOCK_MS: Final = 5
STATEMENT_MS: Final = 500
#: For how long a server may be silent about a statement, in seconds: it has stopped, or its network
#: has. About a commit: whoever stopped waiting would not know whether it was done.
SILENCE_S: Final = 1.0
COMMIT_S: Final = 15.0

#: For how long a server is let be that did not answer in time, and one that is far, in seconds.
REST_S = 5.0
FAR_S: Final = 300.0

_LIMITS = f"SET lock_timeout = {LOCK_MS}; SET statement_timeout = {STATEMENT_MS}"
#: What PostgreSQL calls a row that is not free, and a statement that took too long.
_LOCKED, _TOO_SLOW = "55P03", "57014"

log = logging.getLogger(__name__)


class Impatient:
    """An engine for who does not wait. connections: as many as it needs at the same time."""

    def __init__(self, engine: Engine, connections: int) -> None:
        self.engine = engine
        self._connections = connections
        self._opening = threading.Lock()
        self._is_sqlite = engine.dialect.name == "sqlite"
        #: Whether it is asked at all; PostgreSQL not before somebody who waits was answered.
        self.is_asked = self._is_sqlite
        self._rests_until = 0.0
        if self._is_sqlite:
            event.listen(engine, "connect", _wait_for_no_writer)
        else:
            event.listen(engine, "connect", _set_limits)
            event.listen(engine, "begin", partial(_wait_for, SILENCE_S))
            event.listen(engine, "commit", partial(_wait_for, COMMIT_S))

    @contextmanager
    def asked(self, session: Session) -> Iterator[None]:
        """Within this, a session of the engine that would have to wait raises NeedsPatienceError.

        Nothing was done then, and all of it can be begun anew by who waits. Of a commit that was
        lost nobody can say that.
        """
        try:
            yield
        except CommitLostError:
            self._let_be(REST_S)
            raise
        except OperationalError as error:
            if _is_held_by_another(error.orig):
                raise patience.BusyError from None
            self._let_be(REST_S)
            if getattr(error.orig, "sqlstate", None) != _TOO_SLOW:
                # What the server may say yet belongs to nobody any more.
                session.invalidate()
            raise patience.NeedsPatienceError from None

    def answered(self) -> None:
        """Somebody who waits was answered, in a thread: the server may be asked again."""
        if self.is_asked or time.monotonic() < self._rests_until:
            return
        if self._opening.acquire(blocking=False):
            try:
                self.is_asked = self._is_sqlite or self._is_opened()
            finally:
                self._opening.release()

    def _is_opened(self) -> bool:
        """Whether all connections are there, and the way of each is short."""
        opened: list[Connection] = []
        try:
            opened += [self.engine.connect() for _ in range(self._connections)]
            away_s = min(min(map(_trip_s, opened)) for _ in range(TRIPS))
        except DBAPIError as error:
            log.warning("the database did not open a connection for who does not wait: %s", error)
            self._let_be(REST_S)
            return False
        finally:
            for connection in opened:
                connection.close()
        if away_s > NEAR_S:
            log.info("the database is %.1f ms away: whoever asks it is in a thread", 1000 * away_s)
            self._let_be(FAR_S)
        return away_s <= NEAR_S

    def _let_be(self, seconds: float) -> None:
        self.is_asked = False
        self._rests_until = time.monotonic() + seconds


def _set_limits(connection: Any, _record: Any) -> None:
    connection.execute(_LIMITS)
    connection.commit()


def _wait_for(seconds: float, connection: Connection) -> None:
    """For how long the driver waits for the server from now on."""
    driver: Any = connection.connection.dbapi_connection
    driver.wait = partial(type(driver).wait, driver, timeout=seconds)


def _trip_s(connection: Connection) -> float:
    begun = time.perf_counter()
    connection.exec_driver_sql("SELECT 1")
    return time.perf_counter() - begun


def _wait_for_no_writer(connection: Any, _record: Any) -> None:
    connection.execute("PRAGMA busy_timeout = 0").close()


def _is_held_by_another(refused: BaseException | None) -> bool:
    if isinstance(refused, sqlite3.Error):
        return refused.sqlite_errorcode == sqlite3.SQLITE_BUSY
    return getattr(refused, "sqlstate", None) == _LOCKED
