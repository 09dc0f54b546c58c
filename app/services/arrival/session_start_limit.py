"""Rate limit on abandoned session starts.

Anyone can start sessions of an open study, and each takes storage. Network addresses are no
measure: the thirty people of a laboratory share one, and an attacker has many. What is counted is
what only a program leaves in such numbers: sessions without a response. Participants with a
platform id have a further allowance that those without one cannot use up.
"""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from app.services.runtime.errors import TooManyBegunError
from app.services.studies.repository import StudyInfo
from app.services.studies.session_modes import LIVE
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import SessionRow
from app.study.stages import Stage

from . import entry_links

WITHIN = timedelta(hours=1)

#: Stages in which a session may have no response to a query that counts.
_EARLY = tuple(
    stage.value
    for stage in (
        *(Stage.CONSENT, Stage.DEVICE_CHECK, Stage.INSTRUCTIONS, Stage.FAMILIARISATION),
        *(Stage.PRACTICE, Stage.QUERY, Stage.DECLINED, Stage.WITHDRAWN, Stage.SCREENED_OUT),
    )
)


def require(
    db: Session, study: StudyInfo, limit: int, now: datetime, *, mode: str, is_named: bool
) -> None:
    """Raise TooManyBegunError if `limit` sessions without a response started within the hour.

    mode: each mode is counted separately, so that previews do not use up the allowance of live
    sessions. is_named: whether the request carries a platform id, which doubles the limit; the id
    cannot be verified.

    Deleted sessions count on the day of their deletion, since their start is no longer known. Live
    sessions of a study with single-use links are not limited here, but by the number of links.
    """
    if mode == LIVE and entry_links.required(study.plan):
        return
    if is_named:
        limit *= 2
    # Deleting sessions must not free the allowance.
    left = limit - _deleted_today(db, study, mode, now)
    oldest = None if left < 1 else _oldest(db, study, mode, left, now)
    if left >= 1 and oldest is None:
        return
    # If the deleted sessions alone reach the limit, it holds until the end of the day.
    until = oldest + WITHIN if oldest is not None else _day(now) + timedelta(days=1)
    raise TooManyBegunError(
        f"expected at most {limit} sessions of the study {study.slug!r} to begin within an hour"
        " without an answer",
        until,
    )


def _oldest(db: Session, study: StudyInfo, mode: str, count: int, now: datetime) -> datetime | None:
    """When the `count`-th newest of these sessions started; None if there are fewer."""
    return db.scalar(
        select(SessionRow.started_at)
        .where(
            SessionRow.study_id == study.id,
            SessionRow.mode == mode,
            SessionRow.stage.in_(_EARLY),
            SessionRow.trial_index == 0,
            or_(SessionRow.query_index == 0, SessionRow.stage == Stage.PRACTICE.value),
            SessionRow.started_at > now - WITHIN,
        )
        .order_by(SessionRow.started_at.desc())
        .offset(count - 1)
        .limit(1)
    )


def _deleted_today(db: Session, study: StudyInfo, mode: str, now: datetime) -> int:
    count = select(func.count(Tombstone.id)).where(
        Tombstone.study_id == study.id,
        Tombstone.mode == mode,
        Tombstone.stage.in_(_EARLY),
        Tombstone.reason == "wish",
        Tombstone.deleted_at == _day(now),
    )
    return db.scalar(count) or 0


def _day(now: datetime) -> datetime:
    """The start of the day."""
    return now.replace(hour=0, minute=0, second=0, microsecond=0)
