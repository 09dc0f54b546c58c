"""What at most one does at a time, however many servers and workers there are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from hashlib import sha256

from sqlalchemy import text
from sqlalchemy.orm import Session

from .database import Database


class AdvisoryLock(IntEnum):
    """What is done alone: any numbers that nobody else uses as PostgreSQL's advisory locks."""

    MIGRATION = 7_262_030_001
    RETENTION = 7_262_030_002


@contextmanager
def try_advisory_lock(database: Database, what: AdvisoryLock) -> Iterator[bool]:
    """Yields whether nobody else is at it; until the block ends, nobody else will be.

    SQLite has one server alone, which has nobody to agree with: always True.
    """
    if database.is_sqlite:
        yield True
        return
    with database.engine.connect() as connection:
        # The lock is the session's, not a transaction's: none stays open while the work is done.
        is_alone = bool(
            connection.scalar(text("SELECT pg_try_advisory_lock(:what)"), {"what": what})
        )
        connection.commit()
        try:
            yield is_alone
        finally:
            if is_alone:
                connection.execute(text("SELECT pg_advisory_unlock(:what)"), {"what": what})
                connection.commit()


#: Locks of two numbers, of which this is the first, never meet those of one number above.
_TURNS = 7262


def advisory_xact_lock(db: Session, key: str) -> None:
    """Wait until no other transaction is at what `key` names; none will be until this one ends.

    On SQLite whoever writes is alone anyway.
    """
    if db.get_bind().dialect.name == "sqlite":
        return
    number = int.from_bytes(sha256(key.encode()).digest()[:4], signed=True)
    lock = text("SELECT pg_advisory_xact_lock(CAST(:turns AS integer), CAST(:number AS integer))")
    db.execute(lock, {"turns": _TURNS, "number": number})
