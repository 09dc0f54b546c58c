"""Detects a server clock that is behind the times in the database."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import func, select

from app.services.context import AppContext
from app.storage.models.studies import SessionRow

#: Tolerated difference; the clocks of several servers differ by less.
_DIFFER = timedelta(minutes=5)

#: Only the newest sessions are checked, which include all that are active now.
_NEWEST = 100


def clock_lag(app: AppContext) -> timedelta | None:
    """By how much the newest stored time is ahead of the clock; None within the tolerance."""
    newest = select(SessionRow.last_seen_at).order_by(SessionRow.id.desc()).limit(_NEWEST)
    with app.database.read() as db:
        last: datetime | None = db.scalar(select(func.max(newest.subquery().c.last_seen_at)))
    if last is None:
        return None
    by = last - app.now()
    return by if by > _DIFFER else None


def lag_in_words(by: timedelta) -> str:
    """The difference in words."""
    return f"{by.days:,} days" if by.days > 1 else f"{by // timedelta(minutes=1):,} minutes"
