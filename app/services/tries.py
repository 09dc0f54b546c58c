"""How often a password may be tried: counted by address, whether anybody has it or not."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from app.storage.accounts import FailedSignIn
from app.storage.alone import take_turn

from .errors import TooManyTriesError
from .tokens import secret_hash

#: Enough for somebody who looks for the right one among their own; hopeless for who guesses.
TRIES = 10
WITHIN = timedelta(minutes=15)


def spend(session: Session, now: datetime, email: str) -> None:
    """Count one try, before it is known whether it succeeds. Raises TooManyTriesError."""
    hashed = _key(email)
    # Of many at once each has to see those that were counted before it.
    take_turn(session, hashed)
    session.execute(delete(FailedSignIn).where(FailedSignIn.failed_at <= now - WITHIN))
    times = session.scalars(
        select(FailedSignIn.failed_at)
        .where(FailedSignIn.key_hash == hashed)
        .order_by(FailedSignIn.failed_at.desc())
        .limit(TRIES)
    ).all()
    if len(times) == TRIES:
        until = times[-1] + WITHIN
        raise TooManyTriesError(f"expected at most {TRIES} tries in 15 minutes", until)
    session.add(FailedSignIn(key_hash=hashed, failed_at=now))


def was_wrong(session: Session, now: datetime, email: str) -> None:
    """The newest try of an address has failed: its minutes begin now."""
    newest = select(func.max(FailedSignIn.id)).where(FailedSignIn.key_hash == _key(email))
    session.execute(
        update(FailedSignIn)
        .where(FailedSignIn.id == newest.scalar_subquery())
        .values(failed_at=now)
        .execution_options(synchronize_session=False)
    )


def forgive(session: Session, email: str) -> None:
    """Forget the tries of an address once one succeeds."""
    session.execute(delete(FailedSignIn).where(FailedSignIn.key_hash == _key(email)))


def _key(email: str) -> str:
    return secret_hash(f"sign-in:{email}")
