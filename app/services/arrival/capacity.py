"""Capacity of a study: how many of its places completed and active sessions take."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, and_, func, or_, select
from sqlalchemy.orm import Session

from app.services.runtime.errors import StudyFullError
from app.services.sessions import state_view as session_state
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import SessionRow
from app.study.stages import Stage


def by_order(db: Session, study: StudyInfo, mode: str, now: datetime) -> Counter[int]:
    """The number of completed and active sessions per order of conditions."""
    held = db.execute(
        select(SessionRow.order_index, func.count(SessionRow.id))
        .where(SessionRow.mode == mode, _held(study, now))
        .group_by(SessionRow.order_index)
    )
    return Counter({row[0]: row[1] for row in held})


def require(db: Session, study: StudyInfo, mode: str, now: datetime) -> None:
    """Raise StudyFullError if completed and active sessions fill the study's places."""
    places = study.plan.places
    if places is not None and by_order(db, study, mode, now).total() >= places:
        raise StudyFullError(f"all {places} places of the study {study.slug!r} are taken")


def _held(study: StudyInfo, now: datetime) -> ColumnElement[bool]:
    """The condition that a session takes a place: completed, or active within the study's lease.

    A session without activity loses its place, since abandoned sessions would otherwise use up one
    order of conditions.
    """
    lease = timedelta(minutes=study.plan.lease_minutes)
    return and_(
        SessionRow.study_id == study.id,
        or_(
            SessionRow.stage == Stage.COMPLETED.value,
            and_(
                SessionRow.stage.not_in(session_state.ENDED),
                SessionRow.last_seen_at >= now - lease,
            ),
        ),
    )
