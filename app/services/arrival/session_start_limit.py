"""How many sessions of a study may be begun and not gone on with.

Anybody may begin one where a study is open to everybody, and each takes room. Addresses tell
nothing: a laboratory's thirty people come by one, and a stranger by many. So what is counted is
what only a stranger's program leaves behind in such numbers: sessions without an answer. Whoever
comes with a platform's id has as much room again, which those without one cannot take.
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
from app.study.protocol import Stage

from . import entry_links

WITHIN = timedelta(hours=1)

#: Where a session can be that has answered no pair that counts.
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
    """Raises TooManyBegunError if `limit` sessions began within the hour and answered nothing.

    mode: each mode is counted for itself, so that previews take no room from those who take part.
    is_named: whether a platform's id came along, as it does with all whom the platform sends: twice
    as many have to have begun then. Nobody can say whether an id is a true one.

    Deleted ones are counted by the day on which they were: nothing more is known of them. Live
    sessions of a study of single-use links have a bound of their own: how many links it gave out.
    """
    if mode == LIVE and entry_links.wanted(study.plan):
        return
    if is_named:
        limit *= 2
    # Deleting what was begun must not make room for more.
    left = limit - _deleted_today(db, study, mode, now)
    oldest = None if left < 1 else _oldest(db, study, mode, left, now)
    if left >= 1 and oldest is None:
        return
    # Where deleted ones alone are too many, that is so until their day is over.
    until = oldest + WITHIN if oldest is not None else _day(now) + timedelta(days=1)
    raise TooManyBegunError(
        f"expected at most {limit} sessions of the study {study.slug!r} to begin within an hour"
        " without an answer",
        until,
    )


def _oldest(db: Session, study: StudyInfo, mode: str, count: int, now: datetime) -> datetime | None:
    """When the last but `count` of these sessions began; None if there are fewer."""
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
    """When the day began."""
    return now.replace(hour=0, minute=0, second=0, microsecond=0)
