"""Which response may be taken back now, and for how long: one rule for what is offered and done."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy.orm import Session

from app.services.studies.repository import stored_plan
from app.storage.models.studies import QueryRow, SessionRow
from app.study.protocol import Stage
from app.study.time_left import seconds_left

from . import queries
from .queries import OpenQuery

#: The page counts from when the state arrived there: this much later it may still ask, in seconds.
GRACE_S = 3.0


@dataclass(frozen=True)
class Offer:
    """query: whose response may be taken back. seconds_left: what a page may still count down."""

    query: QueryRow
    seconds_left: float


def find(db: Session, session: SessionRow, trial: OpenQuery, now: datetime) -> Offer | None:
    """The response that may be taken back, or None.

    It is the one just before the trial's open query, given within `undo_s` seconds and the grace,
    if nothing has happened to the open query: with that query, what is kept of it would go.
    Answers of the practice count for nothing, and are not taken back.
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
    # A query that was just opened has nothing that could have been taken back.
    if trial.just_answered is None and queries.was_undone(db, trial.public_id):
        return None
    return Offer(before, max(in_all - GRACE_S, 0.0))
