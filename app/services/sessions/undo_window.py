"""Which response may be undone now, and for how long; used for the offer and for the act."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy.orm import Session

from app.services.studies.repository import stored_plan
from app.storage.models.studies import QueryRow, SessionRow
from app.study.stages import Stage
from app.study.time_left import seconds_left

from . import queries
from .queries import OpenQuery

#: Seconds after the deadline in which undo is accepted: the page counts from the state's arrival.
GRACE_S = 3.0


@dataclass(frozen=True)
class Offer:
    """query: the one whose response may be undone. seconds_left: for the countdown on the page."""

    query: QueryRow
    seconds_left: float


def find(db: Session, session: SessionRow, trial: OpenQuery, now: datetime) -> Offer | None:
    """The response that may be undone, or None.

    It is that of the query before the open one, given within `undo_s` seconds and the grace period,
    if the open query has no history of its own, such as an attempt that was set aside, which would
    be deleted with it. Responses of the practice do not count and cannot be undone.
    """
    undo_s = stored_plan(session.plan).query.undo_s
    if not undo_s or session.stage != Stage.QUERY or trial.attempt > 0:
        return None
    before = trial.just_answered or queries.previous_query(db, trial)
    if before is None or before.response is None:
        return None
    ends_at = before.response.answered_at + timedelta(seconds=undo_s)
    in_all = seconds_left(undo_s + GRACE_S, ends_at + timedelta(seconds=GRACE_S), now)
    if in_all <= 0:
        return None
    # A query that was just opened cannot have an undone response.
    if trial.just_answered is None and queries.was_undone(db, trial.public_id):
        return None
    return Offer(before, max(in_all - GRACE_S, 0.0))
