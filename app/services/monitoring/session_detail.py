"""One session in detail: its trials, their queries and responses, and what was learnt from them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session, joinedload, selectinload

from app.services.context import AppContext
from app.services.proposals.proposer import RecordingRef
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import (
    Acquired,
    Event,
    PreferenceRow,
    QueryRow,
    SessionRow,
    Trial,
    UndoneResponse,
)

from .candidate_videos import Video, video
from .watch_summary import summary


@dataclass(frozen=True)
class Asked:
    """One query with its response.

    preferences: winner, loser, and whether synthesised. seen: playback (see `watch_summary`) by
    column; None without events.
    """

    number: int
    trial_type: str
    left: Video
    right: Video
    response: str | None
    skip_reason: str | None
    seconds: float | None
    preferences: tuple[tuple[int, int, bool], ...]
    seen: Mapping[str, Any] | None
    undone: tuple[str, ...]
    fault: str | None
    acquired: int | None


@dataclass(frozen=True)
class TrialDetail:
    """One trial; index -1 is the practice.

    acquired: the present acquired candidate, if any. best: its recordings: none where machines
    record, until it is asked for.
    """

    index: int
    condition: str
    method: str
    environment: str
    started_at: datetime
    ended_at: datetime | None
    asked: tuple[Asked, ...]
    acquired: int | None
    best: tuple[Video, ...]


@dataclass(frozen=True)
class SessionDetail:
    """One session with all its trials."""

    session_id: str
    participant_id: str
    mode: str
    stage: str
    platform: str | None
    language: str
    started_at: datetime
    last_seen_at: datetime
    ended_at: datetime | None
    plan_version: int
    trials: tuple[TrialDetail, ...]


#: Names of the values of `summary`, in order.
_SEEN = (
    "replays",
    "left_watched",
    "right_watched",
    "dropped_frames",
    "stalls",
    "start_skew_ms",
    "worst_drift_ms",
    "left_width_px",
    "right_width_px",
    "hidden",
    "blurred",
    "fullscreen",
    "pressed_with",
    "layout",
    "turns",
    "resizes",
)


def session_detail(app: AppContext, study: StudyInfo, session_id: str) -> SessionDetail:
    """Read a session by its public id. Raises NotFoundError if the study has no such session."""
    with app.database.read() as db:
        row = find_session(db, study, session_id)
        seen = _seen(db, row.id)
        trials = db.scalars(
            select(Trial)
            .where(Trial.session_id == row.id)
            .order_by(Trial.trial_index)
            .options(
                selectinload(Trial.queries).options(
                    joinedload(QueryRow.left_recording),
                    joinedload(QueryRow.right_recording),
                    joinedload(QueryRow.response),
                )
            )
        ).all()
        return SessionDetail(
            session_id=row.public_id,
            participant_id=row.participant.pseudonym,
            mode=row.mode,
            stage=row.stage,
            platform=row.platform,
            language=row.language,
            started_at=row.started_at,
            last_seen_at=row.last_seen_at,
            ended_at=row.ended_at,
            plan_version=row.plan.version,
            trials=tuple(_trial(app, db, study, trial, seen) for trial in trials),
        )


def find_session(db: Session, study: StudyInfo, session_id: str) -> SessionRow:
    """The session's row. Raises NotFoundError if the study has no such session."""
    row = db.scalar(
        select(SessionRow)
        .where(SessionRow.study_id == study.id, SessionRow.public_id == session_id)
        .options(joinedload(SessionRow.participant), joinedload(SessionRow.plan))
    )
    if row is None:
        raise NotFoundError(f"the study {study.slug!r} has no session {session_id!r}")
    return row


def _trial(
    app: AppContext,
    db: Session,
    study: StudyInfo,
    trial: Trial,
    seen: Mapping[tuple[int, int], Mapping[str, Any]],
) -> TrialDetail:
    space = app.proposer.candidate_set(study.id, trial.environment)
    learnt = _preferences(db, trial.id)
    undone = _undone(db, trial.id)
    acquired: dict[int, int] = {
        row.query_index: row.candidate
        for row in db.scalars(select(Acquired).where(Acquired.trial_id == trial.id))
    }
    best = acquired[max(acquired)] if acquired else None
    clips: Sequence[RecordingRef] = () if best is None else space.recordings[best]
    shown = [
        one
        for query in trial.queries
        for one in (query.left_recording, query.right_recording)
        if one is not None
    ]
    there = app.recordings.sizes([*shown, *clips])
    asked = tuple(
        Asked(
            number=query.query_index + 1,
            trial_type=query.trial_type,
            left=video(there, space, query.left_candidate, query.left_recording),
            right=video(there, space, query.right_candidate, query.right_recording),
            response=query.response.response if query.response else None,
            skip_reason=query.response.skip_reason if query.response else None,
            seconds=_seconds(query),
            preferences=() if query.set_aside_at else learnt.get(query.query_index, ()),
            seen=None if query.set_aside_at else seen.get((trial.trial_index, query.query_index)),
            undone=undone.get(query.id, ()),
            fault=(query.fault or "not said") if query.set_aside_at else None,
            acquired=None if query.set_aside_at else acquired.get(query.query_index),
        )
        for query in trial.queries
        # A pair that a machine has not recorded yet was not shown.
        if query.left_recording is not None and query.right_recording is not None
    )
    return TrialDetail(
        index=trial.trial_index,
        condition=trial.condition,
        method=trial.method,
        environment=trial.environment,
        started_at=trial.started_at,
        ended_at=trial.ended_at,
        asked=asked,
        acquired=best,
        best=tuple(video(there, space, best, clip) for clip in clips if best is not None),
    )


def _seconds(query: QueryRow) -> float | None:
    if query.response is None or query.response.rt_ms is None:
        return None
    return query.response.rt_ms / 1000


def _preferences(db: Session, trial_id: int) -> Mapping[int, tuple[tuple[int, int, bool], ...]]:
    found: dict[int, tuple[tuple[int, int, bool], ...]] = defaultdict(tuple)
    for row in db.scalars(
        select(PreferenceRow)
        .where(PreferenceRow.trial_id == trial_id)
        .order_by(PreferenceRow.preference_index)
    ):
        found[row.query_index] += ((row.winner, row.loser, row.origin == "synthesis"),)
    return found


def _undone(db: Session, trial_id: int) -> Mapping[int, tuple[str, ...]]:
    found: dict[int, tuple[str, ...]] = defaultdict(tuple)
    for query_id, response in db.execute(
        select(UndoneResponse.query_id, UndoneResponse.response)
        .join(QueryRow, UndoneResponse.query_id == QueryRow.id)
        .where(QueryRow.trial_id == trial_id)
        .order_by(UndoneResponse.id)
    ):
        found[query_id] += (response,)
    return found


def _seen(db: Session, session_key: int) -> Mapping[tuple[int, int], Mapping[str, Any]]:
    events = db.scalars(
        select(Event)
        .where(Event.session_id == session_key)
        .order_by(Event.trial_index, Event.query_index, Event.id)
    )
    return {
        place: dict(zip(_SEEN, summary(list(happened)), strict=True))
        for place, happened in groupby(events, key=lambda e: (e.trial_index, e.query_index))
    }
