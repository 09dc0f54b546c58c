"""How many declined on the consent page: a number for each study and day, and nothing of anybody.

It counts presses of the button. Who reads the consent and leaves without a word is not counted.
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
    """Count one more today, if the study is open."""
    day = app.now().replace(hour=0, minute=0, second=0, microsecond=0)
    with app.database.write() as db:
        study_id = db.scalar(select(Study.id).where(Study.slug == slug, Study.status == "open"))
        if study_id is None:
            return
        # Of two who decline first on a day, the second finds the row of the first.
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


def counted(app: AppContext, study_id: int, modes: Sequence[str]) -> int:
    """How often somebody declined so, if live sessions are asked for: no other mode has any."""
    if "live" not in modes:
        return 0
    number = select(func.sum(DeclinedCount.number)).where(DeclinedCount.study_id == study_id)
    with app.database.read() as db:
        return db.scalar(number) or 0
