"""What a browser saw of a pair: which events are kept, how many, and how many were not.

An answer is taken however much comes with it. Events of unknown names, and those beyond the limits
of a call and of a session, are counted: in the table of events as `left_out`, with the number, and
for the study's overview.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.storage.tables import Event, QueryRow, SessionRow
from app.study.plan import Plan

from . import fault_counts, queries
from .queries import Happening
from .studies import stored_plan

#: Of one call: a pair that is watched, replayed and left for another window has 30 or so.
MOST_A_CALL: Final = 60
#: Of one session, or `A_PAIR` for each pair of its plan where that is more.
MOST_A_SESSION: Final = 2_000
A_PAIR: Final = 30
#: The longest value, in characters.
LONGEST_VALUE: Final = 100

#: What the server notes of events that it did not keep; the value is their number.
LEFT_OUT: Final = "left_out"

#: What pages tell, and what programs may tell of players of their own.
NAMES: Final = frozenset(
    (
        *("shown", "visible", "hidden", "blur", "focus", "fullscreen", "pressed", "replay"),
        *("playing", "ended", "retry", "recovered", "stall", "halted", "error", "start_skew"),
        *("watched", "width", "dropped_frames", "worst_drift", "replays"),
        *("play", "pause", "stalled", "waiting", "seeking", "seeked", "ratechange", "canplay"),
    )
)


def keep(
    session: Session,
    row: SessionRow,
    query: QueryRow,
    happenings: Sequence[Happening],
    left_out: int,
    now: datetime,
) -> None:
    """Store what was seen of a query, as far as the limits go, and how much was left out."""
    known = [one for one in happenings if one.event in NAMES]
    # With an answer comes, besides its events, how often the pair was played again.
    kept = known[: min(MOST_A_CALL + 1, _room(session, row))]
    left_out += len(happenings) - len(kept)
    if left_out:
        last = max((one.time_ms for one in happenings), default=0.0)
        kept.append(Happening(LEFT_OUT, None, last, str(left_out)))
        fault_counts.add(session, row.study_id, fault_counts.Kind.EVENTS, left_out, now)
    queries.store_events(session, row, query, kept)


def most_of_a_session(plan: Plan) -> int:
    """How many events are kept of a session under this plan."""
    pairs = plan.trials * plan.queries_per_trial + plan.practice.queries
    return max(MOST_A_SESSION, A_PAIR * pairs)


def _room(session: Session, row: SessionRow) -> int:
    """How many more events of this session are kept."""
    most = most_of_a_session(stored_plan(row.plan))
    there = select(Event.id).where(Event.session_id == row.id).limit(most).subquery()
    return most - (session.scalar(select(func.count()).select_from(there)) or 0)
