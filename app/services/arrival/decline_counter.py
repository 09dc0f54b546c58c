"""Counts how often the consent was declined: one number per study and day, and no personal data.

Only presses of the decline button are counted, not readers who leave the page.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select, update
from sqlalchemy.engine import CursorResult

from app.services.context import AppContext
from app.storage.advisory_lock import advisory_xact_lock
from app.storage.models.consents import DeclinedCount
from app.storage.models.studies import Study


def count(app: AppContext, slug: str) -> None:
    """Add one to today's number if the study is open."""
    day = app.now().replace(hour=0, minute=0, second=0, microsecond=0)
    with app.database.write() as db:
        study_id = db.scalar(select(Study.id).where(Study.slug == slug, Study.status == "open"))
        if study_id is None:
            return
        # Serialised, so that only one of two parallel calls inserts the row of the day.
        advisory_xact_lock(db, f"declined {study_id}")
        counted = db.execute(
            update(DeclinedCount)
            .where(DeclinedCount.study_id == study_id, DeclinedCount.day == day)
            .values(number=DeclinedCount.number + 1)
            .execution_options(synchronize_session=False)
        )
        assert isinstance(counted, CursorResult)
        if not counted.rowcount:
            db.add(DeclinedCount(study_id=study_id, day=day, number=1))


def total(app: AppContext, study_id: int, modes: Sequence[str]) -> int:
    """The study's total number of declines. It is zero unless `modes` includes live sessions."""
    if "live" not in modes:
        return 0
    number = select(func.sum(DeclinedCount.number)).where(DeclinedCount.study_id == study_id)
    with app.database.read() as db:
        return db.scalar(number) or 0
