"""Rate limit on password attempts: a sliding window in the database, with a growing delay.

Attempts are counted per address and origin. A browser in which the account signed in before has a
counter of its own, so that strangers who try the same address do not lock its owner out. All other
attempts are counted per network, and, with a higher limit, in total. Whether the address has an
account makes no difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import ColumnElement, delete, func, select, update
from sqlalchemy.orm import Session

from app.services.runtime.errors import TooManyTriesError
from app.services.runtime.ids import secret_hash
from app.storage.advisory_lock import advisory_xact_lock
from app.storage.models.accounts import FailedSignIn

#: Attempts without a delay: enough to find a half-forgotten password, too few to guess one.
TRIES = 10
#: The same for one address from all networks together, known browsers not counted.
TRIES_FROM_EVERYWHERE = 50
#: How long an attempt counts.
WITHIN = timedelta(minutes=15)


@dataclass(frozen=True)
class CameFrom:
    """The origin of an attempt.

    device: a browser in which this account signed in before, if it is one.
    """

    network: str = ""
    device: str | None = None


ANYWHERE = CameFrom()


@dataclass(frozen=True)
class _Wait:
    """The delay after `free` attempts: `first`, doubled with each further one up to `longest`."""

    free: int
    first: timedelta
    longest: timedelta

    def after(self, tries: int) -> timedelta:
        if tries < self.free:
            return timedelta(0)
        doubled: timedelta = self.first * (1 << min(tries - self.free, 20))
        return min(doubled, self.longest)


#: Length in hexadecimal digits: 128 bits.
_HASH_PREFIX_LENGTH = 32
_LONG_AGO = datetime.min.replace(tzinfo=UTC)
_BY_ONE = _Wait(TRIES, timedelta(seconds=30), timedelta(minutes=5))
_BY_ALL = _Wait(TRIES_FROM_EVERYWHERE, timedelta(seconds=5), timedelta(minutes=1))


def record_attempt(db: Session, now: datetime, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """Count one attempt, before its outcome is known. Raises TooManyTriesError during a delay."""
    key = _key(email, came_from)
    # Serialised, so that each of several parallel attempts sees those counted before it.
    advisory_xact_lock(db, key if came_from.device is not None else _address_prefix(key))
    db.execute(delete(FailedSignIn).where(FailedSignIn.failed_at <= now - WITHIN))
    until = _next_allowed_at(db, _BY_ONE, FailedSignIn.key_hash == key)
    if came_from.device is None:
        start = _address_prefix(key)
        # All keys with this prefix: "g" follows the last hexadecimal digit.
        everywhere = (FailedSignIn.key_hash >= start, FailedSignIn.key_hash < f"{start}g")
        until = max(until, _next_allowed_at(db, _BY_ALL, *everywhere))
    if until > now:
        raise TooManyTriesError("expected fewer tries, or more time between them", until)
    db.add(FailedSignIn(key_hash=key, failed_at=now))


def record_failure(db: Session, now: datetime, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """Restart the window of the newest attempt from this origin, now that it has failed."""
    newest = select(func.max(FailedSignIn.id)).where(
        FailedSignIn.key_hash == _key(email, came_from)
    )
    db.execute(
        update(FailedSignIn)
        .where(FailedSignIn.id == newest.scalar_subquery())
        .values(failed_at=now)
        .execution_options(synchronize_session=False)
    )


def reset(db: Session, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """Delete the attempts for an address from this origin after a successful one."""
    db.execute(delete(FailedSignIn).where(FailedSignIn.key_hash == _key(email, came_from)))


def _next_allowed_at(db: Session, wait: _Wait, *counted: ColumnElement[bool]) -> datetime:
    """When the next attempt is allowed, given the attempts that match `counted`."""
    number, newest = db.execute(
        select(func.count(FailedSignIn.id), func.max(FailedSignIn.failed_at)).where(*counted)
    ).one()
    return _LONG_AGO if newest is None else newest + wait.after(number)


def _key(email: str, came_from: CameFrom) -> str:
    """The counter's key. Without a known device, it begins with the prefix of the address."""
    if came_from.device is not None:
        return secret_hash(f"sign-in:{email}:device:{came_from.device}")
    of_network = secret_hash(f"sign-in:{email}:network:{came_from.network}")
    return _address_prefix(secret_hash(f"sign-in:{email}")) + of_network[_HASH_PREFIX_LENGTH:]


def _address_prefix(key: str) -> str:
    return key[:_HASH_PREFIX_LENGTH]
