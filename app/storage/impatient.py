"""Connections of who does not wait (`patience`): every wait of theirs ends after milliseconds.

SQLite is at hand, and there is only another writer to wait for. PostgreSQL's server may be far
away, stopped or silent: who does not wait asks it as long as it is near and answers, and then again
once somebody who can wait was answered.
"""

from __future__ import annotations

import logging
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

from sqlalchemy import Engine, event
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from . import patience

#: The longest way to a server that is near, there and back, in seconds; a response goes it about
#: ten times.
NEAR_S = 0.002
#: How often the way is gone to find its length.
TRIPS: Final = 10

#: For how long a row that another holds is waited for, and a statement's answer, in milliseconds.
LOCK_MS: Final = 5
STATEMENT_MS: Final = 500
#: For how long a server may say nothing at all, in seconds: it has stopped, or the network has.
SILENCE_S: Final = 1.0
#: For how long a server that is to take up a connection may say nothing, in seconds; libpq's least.
CONNECT_S: Final = 2

_LIMITS = f"SET lock_timeout = {LOCK_MS}; SET statement_timeout = {STATEMENT_MS}"
#: What PostgreSQL calls a row that is not free, and a statement that took too long.
_LOCKED, _TOO_SLOW = "55P03", "57014"

log = logging.getLogger(__name__)


class Impatient:
    """An engine for who does not wait."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        #: Whether it answered when it was asked last, by whomever.
        self.answers = True
        #: Whether the way to it is short enough to be gone while everybody else waits.
        self.is_near = True
        is_sqlite = engine.dialect.name == "sqlite"
        event.listen(engine, "connect", _wait_for_no_writer if is_sqlite else self._set_limits)

    @contextmanager
    def asked(self, session: Session, *, to_commit: bool = False) -> Iterator[None]:
        """Within this, a session of the engine that would have to wait raises NeedsPatienceError.

        Nothing was done then, and all of it can be begun anew by who waits. Of a commit that was
        lost on its way nobody can say that: it raises as ever.
        """
        try:
            yield
        except OperationalError as error:
            if _is_held_by_another(error.orig):
                raise patience.BusyError from None
            if getattr(error.orig, "sqlstate", None) != _TOO_SLOW:
                self.answers = False
                # What the server may say yet belongs to nobody any more.
                session.invalidate()
            if to_commit:
                raise
            raise patience.NeedsPatienceError from None

    def _set_limits(self, connection: Any, _record: Any) -> None:
        connection.wait = partial(connection.wait, timeout=SILENCE_S)
        connection.execute(_LIMITS)
        away_s = min(_trip_s(connection) for _ in range(TRIPS))
        connection.commit()
        self.is_near = away_s <= NEAR_S
        if not self.is_near:
            log.info("the database is %.1f ms away: whoever asks it is in a thread", 1000 * away_s)


def _trip_s(connection: Any) -> float:
    begun = time.perf_counter()
    connection.execute("SELECT 1")
    return time.perf_counter() - begun


def _wait_for_no_writer(connection: Any, _record: Any) -> None:
    connection.execute("PRAGMA busy_timeout = 0").close()


def _is_held_by_another(refused: BaseException | None) -> bool:
    if isinstance(refused, sqlite3.Error):
        return refused.sqlite_errorcode == sqlite3.SQLITE_BUSY
    return getattr(refused, "sqlstate", None) == _LOCKED
