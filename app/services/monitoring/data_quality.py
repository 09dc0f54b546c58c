"""Data-quality flags of sessions, with the same definitions on pages and in exports.

A flag asks the experimenter to look at a session. No session is excluded because of one.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from datetime import datetime
from enum import StrEnum
from itertools import groupby
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Final
from weakref import WeakKeyDictionary

from sqlalchemy import ColumnElement, case, func, select
from sqlalchemy.orm import Session

from app.storage.models.studies import Event, QueryRow, Response, SessionRow, Trial

from .check_outcomes import check_outcomes


class Flag(StrEnum):
    """Kinds of flags."""

    FAST = "fast"
    ONE_SIDED = "one-sided"
    FAILED_CHECKS = "failed-checks"
    UNWATCHED = "unwatched"
    FAULTS = "faults"


#: Response times below this are fast: two videos hardly differ yet, and a choice takes some 300 ms.
FAST_MS: Final = 1_500
#: Share of fast responses that raises the flag: people who watch the videos stay below it.
FAST_SHARE: Final = 0.25
#: Share of choices on one side that raises the flag: of ten random choices, nine or more are on one
#: side in 2 % of the sessions.
ONE_SIDED_SHARE: Final = 0.9
FAILED_SHARE: Final = 0.25
#: A video is unwatched if less than this part was played; and the share of answers with one.
WATCHED_PART: Final = 0.5
UNWATCHED_SHARE: Final = 0.25
#: Fewest answers and fewest checks for which a share is computed.
FEWEST_ANSWERS: Final = 10
FEWEST_CHECKS: Final = 2

LABELS: Final[Mapping[Flag, str]] = MappingProxyType(
    {
        Flag.FAST: "Fast answers",
        Flag.ONE_SIDED: "One-sided answers",
        Flag.FAILED_CHECKS: "Failed checks",
        Flag.UNWATCHED: "Unwatched videos",
        Flag.FAULTS: "Technical faults",
    }
)
#: Definition of each flag, as readers see it.
RULES: Final[Mapping[Flag, str]] = MappingProxyType(
    {
        Flag.FAST: f"{FAST_SHARE:.0%} of the answers or more came within {FAST_MS / 1000:g} s of"
        f" both videos having begun; from {FEWEST_ANSWERS} answers on.",
        Flag.ONE_SIDED: f"{ONE_SIDED_SHARE:.0%} of the choices or more were on one side;"
        f" from {FEWEST_ANSWERS} choices on. Skips do not count.",
        Flag.FAILED_CHECKS: f"More than {FAILED_SHARE:.0%} of the attention checks were failed,"
        f" or more than half of the repeats were answered differently; from {FEWEST_CHECKS} on.",
        Flag.UNWATCHED: f"In {UNWATCHED_SHARE:.0%} of the answers or more, less than half of one"
        f" of the videos had been played; from {FEWEST_ANSWERS} answers on.",
        Flag.FAULTS: "At least one pair was set aside because a video did not play.",
    }
)

#: Events that the server adds when a query is set aside or a response undone: events before them do
#: not belong to the final answer.
_CLOSINGS: Final = ("set_aside", "undone")
_WATCHED: Final = "watched"
#: Rows fetched at a time.
_BATCH: Final = 1_000
#: Sessions whose playback counts are cached, for each database.
_MOST_KNOWN: Final = 50_000
_Known = dict[int, tuple[tuple[datetime, int, int], int, int]]
_KNOWN: WeakKeyDictionary[Any, _Known] = WeakKeyDictionary()


@dataclass(frozen=True)
class Evidence:
    """Counts from one session's trials, without the practice."""

    answers: int = 0
    timed: int = 0
    fast: int = 0
    left: int = 0
    right: int = 0
    attention: int = 0
    attention_failed: int = 0
    repeats: int = 0
    repeats_failed: int = 0
    reported: int = 0
    unwatched: int = 0
    set_aside: int = 0

    def __add__(self, other: Evidence) -> Evidence:
        """The counts of two sessions together."""
        both = zip(astuple(self), astuple(other), strict=True)
        return Evidence(*(one + another for one, another in both))


def flags_of(evidence: Evidence) -> tuple[Flag, ...]:
    """The flags that these counts raise, in the order of `Flag`."""
    choices = evidence.left + evidence.right
    raised = {
        Flag.FAST: _share(evidence.fast, evidence.timed, FEWEST_ANSWERS) >= FAST_SHARE,
        Flag.ONE_SIDED: _share(max(evidence.left, evidence.right), choices, FEWEST_ANSWERS)
        >= ONE_SIDED_SHARE,
        Flag.FAILED_CHECKS: _share(evidence.attention_failed, evidence.attention, FEWEST_CHECKS)
        > FAILED_SHARE
        or _share(evidence.repeats_failed, evidence.repeats, FEWEST_CHECKS) > 0.5,
        Flag.UNWATCHED: _share(evidence.unwatched, evidence.reported, FEWEST_ANSWERS)
        >= UNWATCHED_SHARE,
        Flag.FAULTS: evidence.set_aside > 0,
    }
    return tuple(flag for flag in Flag if raised[flag])


def flags(db: Session, study_id: int, modes: Sequence[str]) -> Mapping[int, tuple[Flag, ...]]:
    """The flags of a study's sessions in these modes, by the session's primary key.

    Sessions without any data have no entry.
    """
    return {key: flags_of(found) for key, found in evidence(db, study_id, modes).items()}


def evidence(db: Session, study_id: int, modes: Sequence[str]) -> Mapping[int, Evidence]:
    """What is counted in a study's sessions in these modes, by the session's primary key."""
    of = (SessionRow.study_id == study_id, SessionRow.mode.in_(modes))
    counted: dict[int, Counter[str]] = defaultdict(Counter)
    for part in (_answers, _checks, _faults, _watching):
        part(db, of, counted)
    return {key: Evidence(**found) for key, found in counted.items()}


_Of = tuple[ColumnElement[bool], ...]
_Counted = dict[int, Counter[str]]


def _answers(db: Session, of: _Of, counted: _Counted) -> None:
    statement = (
        select(
            Trial.session_id,
            func.count(Response.id).label("answers"),
            func.count(Response.rt_ms).label("timed"),
            func.sum(case((Response.rt_ms < FAST_MS, 1), else_=0)).label("fast"),
            func.sum(case((Response.response == "left", 1), else_=0)).label("left"),
            func.sum(case((Response.response == "right", 1), else_=0)).label("right"),
        )
        .select_from(SessionRow)
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(Response, Response.query_id == QueryRow.id)
        .where(Trial.trial_index >= 0, *of)
        .group_by(Trial.session_id)
    )
    for row in db.execute(statement).mappings():
        numbers = {name: int(value) for name, value in row.items() if name != "session_id"}
        counted[row["session_id"]].update(numbers)


def _checks(db: Session, of: _Of, counted: _Counted) -> None:
    for outcome in check_outcomes(db, *of):
        if outcome.passed is not None:
            name = "repeats" if outcome.repeats is not None else "attention"
            counted[outcome.session_key][name] += 1
            counted[outcome.session_key][f"{name}_failed"] += not outcome.passed


def _watching(db: Session, of: _Of, counted: _Counted) -> None:
    """Count answered and unwatched queries, from the last playback events of each query.

    A session has about a thousand events, and live pages ask every second; so the counts are cached
    until the session changes.
    """
    known = _KNOWN.setdefault(db.get_bind(), {})
    if len(known) > _MOST_KNOWN:
        known.clear()
    now = {
        key: (last_seen_at, counted[key]["answers"], counted[key]["set_aside"])
        for key, last_seen_at in db.execute(
            select(SessionRow.id, SessionRow.last_seen_at).where(*of)
        )
    }
    changed = [key for key, at in now.items() if key not in known or known[key][0] != at]
    for start in range(0, len(changed), _BATCH):
        part = changed[start : start + _BATCH]
        found = _watched(db, part)
        known |= {key: (now[key], *found.get(key, (0, 0))) for key in part}
    for key in now:
        _, reported, unwatched = known.get(key, (None, 0, 0))
        counted[key].update(reported=reported, unwatched=unwatched)


def _watched(db: Session, keys: Sequence[int]) -> dict[int, tuple[int, int]]:
    """By session: number of answered queries with playback events, and of unwatched ones."""
    reported: Any = db.execute(
        select(
            Event.session_id,
            Event.trial_index,
            Event.query_index,
            Event.event,
            Event.side,
            Event.value,
        )
        .where(
            Event.session_id.in_(keys),
            Event.event.in_((_WATCHED, *_CLOSINGS)),
            Event.trial_index >= 0,
        )
        .order_by(Event.session_id, Event.id)
        .execution_options(yield_per=_BATCH)
    )
    found: dict[int, tuple[int, int]] = {}
    for session_key, rows in groupby(reported, key=itemgetter(0)):
        seen: dict[tuple[int, int], dict[str | None, float]] = {}
        for _, trial, query, event, side, value in rows:
            if event != _WATCHED:
                # Earlier events do not belong to the final answer.
                seen.pop((trial, query), None)
            elif (part := _part(value)) is not None:
                seen.setdefault((trial, query), {})[side] = part
        unwatched = sum(min(parts.values()) < WATCHED_PART for parts in seen.values())
        found[session_key] = (len(seen), unwatched)
    return found


def _faults(db: Session, of: _Of, counted: _Counted) -> None:
    statement = (
        select(Trial.session_id, func.count(QueryRow.id))
        .select_from(SessionRow)
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .where(QueryRow.set_aside_at.is_not(None), Trial.trial_index >= 0, *of)
        .group_by(Trial.session_id)
    )
    for key, number in db.execute(statement):
        counted[key]["set_aside"] += number


def _share(part: int, whole: int, fewest: int) -> float:
    return part / whole if whole >= fewest else 0.0


def _part(value: str | None) -> float | None:
    """An event's value as a number from 0 to 1; None for anything else a client has sent."""
    try:
        part = float(value or "")
    except ValueError:
        return None
    return part if math.isfinite(part) else None
