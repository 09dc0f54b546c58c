"""The list of a study's sessions, and counts of sessions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import case, exists, func, select

from app.services.context import AppContext
from app.services.sessions.state_view import ENDED, read_progress
from app.services.studies import repository
from app.services.studies.session_modes import ALL
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import Participant, QueryRow, Response, SessionRow, Study, Trial
from app.study.stages import Stage, position

from . import data_quality
from .data_quality import Flag

#: Pairs loaded for each query: browsers prefetch one for each of the three possible responses.
PAIRS_LOADED_PER_QUERY = 3


@dataclass(frozen=True)
class SessionLine:
    """One session in a study's list.

    presence: completed, left (declined, withdrew, screened out), here (last seen within the study's
    lease), or away. consented, began: whether it reached that point. conditions: of its trials, in
    order. flags: see `data_quality`.
    """

    session_id: str
    participant_id: str
    mode: str
    stage: str
    trial: int
    trials: int
    query: int
    queries: int
    answered: int
    skips: int
    started_at: datetime
    last_seen_at: datetime
    ended_at: datetime | None
    presence: str
    consented: bool
    began: bool
    flags: tuple[Flag, ...]


@dataclass(frozen=True)
class Counts:
    """Numbers of sessions of one mode by state."""

    active: int = 0
    completed: int = 0
    withdrawn: int = 0
    declined: int = 0
    screened_out: int = 0

    @property
    def total(self) -> int:
        """Number of sessions in all states."""
        ended = self.completed + self.withdrawn + self.declined + self.screened_out
        return self.active + ended


def payload_mb(app: AppContext, study: repository.StudyInfo) -> float | None:
    """Upper bound of the megabytes of video that one session loads, with all prefetched pairs.

    Estimated from the videos that exist already; None if there are none.
    """
    clips = [
        clip
        for environment in study.plan.environments
        for clip in app.proposer.candidate_set(study.id, environment).all_recordings
    ]
    sizes = app.recordings.sizes(clips)
    if not sizes:
        return None
    mean_bytes = sum(sizes.values()) / len(sizes)
    pairs = study.plan.trials * study.plan.shown_per_trial * PAIRS_LOADED_PER_QUERY
    blocks = study.plan.trials // study.plan.trials_per_block
    return (2 * pairs + blocks * study.plan.familiarisation.videos) * mean_bytes / 1e6


def sessions(
    app: AppContext, study: repository.StudyInfo, modes: Sequence[str] = ALL
) -> list[SessionLine]:
    """The sessions of a study in these modes, the newest first."""
    of_study = SessionRow.study_id == study.id, SessionRow.mode.in_(modes)
    answered = (
        select(
            Trial.session_id,
            func.count(Response.id).label("answered"),
            func.count(Trial.id.distinct()).label("trials"),
            func.sum(case((Response.response == "skip", 1), else_=0)).label("skips"),
        )
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(Response, Response.query_id == QueryRow.id)
        .where(Trial.trial_index >= 0, *of_study)
        .group_by(Trial.session_id)
        .subquery()
    )
    began = exists().where(Trial.session_id == SessionRow.id, Trial.trial_index >= 0)
    statement = (
        select(
            SessionRow,
            Participant.pseudonym,
            answered.c.answered,
            answered.c.skips,
            answered.c.trials,
            began,
        )
        .join(Participant, SessionRow.participant_id == Participant.id)
        .outerjoin(answered, answered.c.session_id == SessionRow.id)
        .where(*of_study)
        .order_by(SessionRow.started_at.desc(), SessionRow.id.desc())
    )
    heard_of_since = app.now() - timedelta(minutes=study.plan.lease_minutes)
    with app.database.read() as db:
        noticed = data_quality.flags(db, study.id, modes)
        lines = []
        for row, pseudonym, responses, skips, begun, has_begun in db.execute(statement):
            where = position(repository.plan_of(row), read_progress(row))
            if row.stage == Stage.WITHDRAWN and begun:
                # An ended session has no position in the protocol, so use that of its last answer.
                before = (begun - 1) * where["queries"]
                where["trial"], where["query"] = begun, max(responses - before, 0)
            lines.append(
                SessionLine(
                    session_id=row.public_id,
                    participant_id=pseudonym,
                    mode=row.mode,
                    stage=row.stage,
                    answered=responses or 0,
                    skips=int(skips or 0),
                    started_at=row.started_at,
                    last_seen_at=row.last_seen_at,
                    ended_at=row.ended_at,
                    presence=_presence(row, heard_of_since),
                    consented=row.consented_at is not None,
                    began=has_begun,
                    flags=noticed.get(row.id, ()),
                    trial=where["trial"],
                    trials=where["trials"],
                    query=where["query"],
                    queries=where["queries"],
                )
            )
        return lines


def _presence(session: SessionRow, heard_of_since: datetime) -> str:
    if session.stage == Stage.COMPLETED:
        return "completed"
    if session.stage in ENDED:
        return "left"
    return "here" if session.last_seen_at >= heard_of_since else "away"


def deleted(app: AppContext, study_id: int, modes: Sequence[str] = ALL) -> int:
    """Number of sessions of these modes that were deleted at the participant's wish."""
    with app.database.read() as db:
        found = db.scalar(
            select(func.count(Tombstone.id)).where(
                Tombstone.study_id == study_id,
                Tombstone.mode.in_(modes),
                Tombstone.reason == "wish",
            )
        )
    return found or 0


def counts(app: AppContext) -> Mapping[tuple[str, str], Counts]:
    """Numbers of sessions by state, for each (slug, mode)."""
    with app.database.read() as db:
        rows = db.execute(
            select(Study.slug, SessionRow.mode, SessionRow.stage, func.count(SessionRow.id))
            .join(Study, SessionRow.study_id == Study.id)
            .group_by(Study.slug, SessionRow.mode, SessionRow.stage)
        ).all()
    by_place: dict[tuple[str, str], Counter[str]] = {}
    for slug, mode, stage, number in rows:
        place = stage if Stage(stage).value in ENDED else "active"
        by_place.setdefault((slug, mode), Counter())[place] += number
    return {key: Counts(**found) for key, found in by_place.items()}
