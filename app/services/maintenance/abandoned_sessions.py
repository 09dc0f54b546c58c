"""Deletes sessions that are still without consent after a day.

A page creates a session only when the participant agrees, so these were created through the API and
abandoned. They leave no tombstone, because nobody took part.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, and_, delete, exists, func, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.studies.session_modes import OF_PEOPLE
from app.storage.models.studies import Participant, SessionRow, Study
from app.study.stages import Stage

KEPT = timedelta(days=1)
#: Sessions deleted in one transaction, few enough not to delay new participants.
_AT_ONCE = 500


def count(app: AppContext) -> int:
    """Number of sessions that are due for deletion."""
    with app.database.read() as db:
        return db.scalar(select(func.count(SessionRow.id)).where(_due(app.now()))) or 0


def delete_abandoned(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete the sessions that are due, and return their number.

    stop: called before each batch; True ends the cleanup.
    """
    with app.database.read() as db:
        studies = db.scalars(select(SessionRow.study_id).where(_due(app.now())).distinct()).all()
    gone = 0
    for study_id in studies:
        while not stop():
            with app.database.write() as db:
                removed = _remove(db, study_id, app.now())
            gone += removed
            if removed < _AT_ONCE:
                break
    if gone:
        # They may include ids of platforms.
        app.database.scrub()
    return gone


def _remove(db: Session, study_id: int, now: datetime) -> int:
    # The same lock as at arrival, so that no session is created for a participant being deleted.
    db.execute(select(Study.id).where(Study.id == study_id).with_for_update())
    batch = (
        select(SessionRow.id)
        .where(SessionRow.study_id == study_id, _due(now))
        .limit(_AT_ONCE)
        .with_for_update()
    )
    ids = db.scalars(batch).all()
    people = db.scalars(
        delete(SessionRow)
        .where(SessionRow.id.in_(ids))
        .returning(SessionRow.participant_id)
        .execution_options(synchronize_session=False)
    ).all()
    db.execute(
        delete(Participant)
        .where(
            Participant.id.in_(people),
            ~exists().where(SessionRow.participant_id == Participant.id),
        )
        .execution_options(synchronize_session=False)
    )
    return len(people)


def _due(now: datetime) -> ColumnElement[bool]:
    return and_(
        SessionRow.mode.in_(OF_PEOPLE),
        SessionRow.stage == Stage.CONSENT.value,
        SessionRow.consented_at.is_(None),
        SessionRow.last_seen_at <= now - KEPT,
    )
