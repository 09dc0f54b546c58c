"""Whether the server's clock is behind what it has stored itself."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import func, select

from app.services.context import AppContext
from app.storage.models.studies import SessionRow

#: By how much clocks may differ without a word: those of several servers do by less.
_DIFFER = timedelta(minutes=5)

#: Only these sessions are looked at, the newest: whoever is there now is among them.
_NEWEST = 100


def behind(app: AppContext) -> timedelta | None:
    """By how much somebody was last seen later than it is now; None where that cannot be told."""
    newest = select(SessionRow.last_seen_at).order_by(SessionRow.id.desc()).limit(_NEWEST)
    with app.database.read() as db:
        last: datetime | None = db.scalar(select(func.max(newest.subquery().c.last_seen_at)))
    if last is None:
        return None
    by = last - app.now()
    return by if by > _DIFFER else None


def said(by: timedelta) -> str:
    """By how much the clock is behind, in words."""
    return f"{by.days:,} days" if by.days > 1 else f"{by // timedelta(minutes=1):,} minutes"
