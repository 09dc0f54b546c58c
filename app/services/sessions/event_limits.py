"""Limits on client events: which names are stored, and how many per call and per session.

A response is accepted regardless of its events. Events with unknown names and those beyond the
limits are dropped and counted, as an event `left_out` with their number and on the study's
overview.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final

from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from app.services import failure_counter
from app.services.studies.repository import stored_plan
from app.storage.models.studies import Event, QueryRow, SessionRow
from app.study.plan import Plan

from . import queries
from .queries import ClientEvent

#: Per call. A pair that is watched, replayed and left for another window produces about 30.
MAX_EVENTS_PER_CALL: Final = 60
#: Per session, or `MAX_EVENTS_PER_PAIR` for each pair of its plan if that is more.
MAX_EVENTS_PER_SESSION: Final = 2_000
MAX_EVENTS_PER_PAIR: Final = 30
#: The longest value, in characters.
LONGEST_VALUE: Final = 100

#: The event that the server stores in place of dropped ones; the value is their number.
LEFT_OUT: Final = "left_out"

#: Events of the pages, and events that programs may send about their own players.
NAMES: Final = frozenset(
    (
        *("shown", "visible", "hidden", "blur", "focus", "fullscreen", "pressed", "replay"),
        *("layout", "resized", "turned"),
        *("playing", "ended", "retry", "recovered", "stall", "halted", "error", "start_skew"),
        *("watched", "width", "dropped_frames", "worst_drift", "replays", "sent_by_form"),
        *("play", "pause", "stalled", "waiting", "seeking", "seeked", "ratechange", "canplay"),
    )
)


def store(
    db: Session,
    session: SessionRow,
    query: QueryRow,
    client_events: Sequence[ClientEvent],
    left_out: int,
    now: datetime,
) -> None:
    """Store the events of a query within the limits, and the number of dropped ones.

    left_out: how many events the client itself dropped.
    """
    if not client_events and not left_out:
        return
    known = [one for one in client_events if one.event in NAMES]
    # One more than the limit: the number of replays comes with a response in addition.
    kept = known[: min(MAX_EVENTS_PER_CALL + 1, _room(db, session))]
    left_out += len(client_events) - len(kept)
    if left_out:
        last = max((one.time_ms for one in client_events), default=0.0)
        kept.append(ClientEvent(LEFT_OUT, None, last, str(left_out)))
        failure_counter.add(db, session.study_id, failure_counter.Kind.EVENTS, left_out, now)
    queries.store_events(db, session, query, kept)


def max_events(plan: Plan) -> int:
    """How many events of a session under this plan are stored."""
    pairs = plan.trials * plan.queries_per_trial + plan.practice.queries
    return max(MAX_EVENTS_PER_SESSION, MAX_EVENTS_PER_PAIR * pairs)


def _room(db: Session, session: SessionRow) -> int:
    """How many more events of this session may be stored."""
    limit = max_events(stored_plan(session.plan))
    there = db.scalar(_STORED, {"session_id": session.id, "limit": limit})
    return limit - (there or 0)


# Built once: for such small queries, building the statement takes as long as executing it.
_STORED = select(func.count()).select_from(
    select(Event.id)
    .where(Event.session_id == bindparam("session_id"))
    .limit(bindparam("limit"))
    .subquery()
)
