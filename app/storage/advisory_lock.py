"""PostgreSQL advisory locks, by which servers and workers exclude each other. No-ops on SQLite."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from hashlib import sha256

from sqlalchemy import text
from sqlalchemy.orm import Session

from .database import Database


class AdvisoryLock(IntEnum):
    """Keys of the advisory locks: arbitrary numbers that no other program is likely to use."""

    MIGRATION = 7_262_030_001
    RETENTION = 7_262_030_002


@contextmanager
def try_advisory_lock(database: Database, what: AdvisoryLock) -> Iterator[bool]:
    """Try to take a lock for the block, without waiting. Yields whether it was taken.

    Always True on SQLite, which serves one process only.
    """
    if database.is_sqlite:
        yield True
        return
    with database.engine.connect() as connection:
        # A lock of the connection, so that no transaction stays open during the block.
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


#: First key of the two-key locks, whose key space is separate from that of the one-key locks above.
_TURNS = 7262


def advisory_xact_lock(db: Session, key: str) -> None:
    """Take the lock of this key for the rest of the transaction; blocks until it is free.

    A no-op on SQLite, where writing transactions exclude each other.
    """
    if db.get_bind().dialect.name == "sqlite":
        return
    number = int.from_bytes(sha256(key.encode()).digest()[:4], signed=True)
    lock = text("SELECT pg_advisory_xact_lock(CAST(:turns AS integer), CAST(:number AS integer))")
    db.execute(lock, {"turns": _TURNS, "number": number})
