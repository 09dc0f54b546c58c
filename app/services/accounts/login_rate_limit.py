"""How often a password may be tried: after some tries a wait, which grows with each further one.

Tries are counted by the address that is signed in to and by where they come from. A browser in
which that account signed in before is counted apart from all others: strangers who try the same
address do not keep it out. The others are counted by their network, and, with more room, all
together. Whether an account of that address exists makes no difference.
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

#: Enough for somebody who looks for the right one among their own; hopeless for who guesses.
TRIES = 10
#: From everywhere but browsers that are known: more people than one may look for theirs.
TRIES_FROM_EVERYWHERE = 50
#: For how long a try is counted.
WITHIN = timedelta(minutes=15)


@dataclass(frozen=True)
class CameFrom:
    """Where a try comes from. `device`: a browser in which this account signed in before."""

    network: str = ""
    device: str | None = None


ANYWHERE = CameFrom()


@dataclass(frozen=True)
class _Wait:
    """After `free` tries: `first`, doubled by each further one, and never more than `longest`."""

    free: int
    first: timedelta
    longest: timedelta

    def after(self, tries: int) -> timedelta:
        if tries < self.free:
            return timedelta(0)
        doubled: timedelta = self.first * (1 << min(tries - self.free, 20))
        return min(doubled, self.longest)


#: 128 bits of a hash.
_HALF = 32
_LONG_AGO = datetime.min.replace(tzinfo=UTC)
_BY_ONE = _Wait(TRIES, timedelta(seconds=30), timedelta(minutes=5))
_BY_ALL = _Wait(TRIES_FROM_EVERYWHERE, timedelta(seconds=5), timedelta(minutes=1))


def spend(db: Session, now: datetime, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """Count one try, before it is known whether it succeeds. Raises TooManyTriesError."""
    key = _key(email, came_from)
    # Of many at once each has to see those that were counted before it.
    advisory_xact_lock(db, key if came_from.device is not None else _of_address(key))
    db.execute(delete(FailedSignIn).where(FailedSignIn.failed_at <= now - WITHIN))
    until = _until(db, _BY_ONE, FailedSignIn.key_hash == key)
    if came_from.device is None:
        start = _of_address(key)
        # All that begin so: the next letter is no digit of a hash.
        everywhere = (FailedSignIn.key_hash >= start, FailedSignIn.key_hash < f"{start}g")
        until = max(until, _until(db, _BY_ALL, *everywhere))
    if until > now:
        raise TooManyTriesError("expected fewer tries, or more time between them", until)
    db.add(FailedSignIn(key_hash=key, failed_at=now))


def was_wrong(db: Session, now: datetime, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """The newest try from there has failed: its minutes begin now."""
    newest = select(func.max(FailedSignIn.id)).where(
        FailedSignIn.key_hash == _key(email, came_from)
    )
    db.execute(
        update(FailedSignIn)
        .where(FailedSignIn.id == newest.scalar_subquery())
        .values(failed_at=now)
        .execution_options(synchronize_session=False)
    )


def forgive(db: Session, email: str, came_from: CameFrom = ANYWHERE) -> None:
    """Forget the tries of an address from there once one succeeds."""
    db.execute(delete(FailedSignIn).where(FailedSignIn.key_hash == _key(email, came_from)))


def _until(db: Session, wait: _Wait, *counted: ColumnElement[bool]) -> datetime:
    """When the next try is taken after these."""
    number, newest = db.execute(
        select(func.count(FailedSignIn.id), func.max(FailedSignIn.failed_at)).where(*counted)
    ).one()
    return _LONG_AGO if newest is None else newest + wait.after(number)


def _key(email: str, came_from: CameFrom) -> str:
    """What a try is counted as. But for known devices, it begins with what the address has."""
    if came_from.device is not None:
        return secret_hash(f"sign-in:{email}:device:{came_from.device}")
    of_network = secret_hash(f"sign-in:{email}:network:{came_from.network}")
    return _of_address(secret_hash(f"sign-in:{email}")) + of_network[_HALF:]


def _of_address(key: str) -> str:
    return key[:_HALF]
