"""What an experimenter sees of a study under way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import case, func, select

from app.storage.arrivals import Tombstone
from app.storage.tables import (
    Participant,
    QueryRow,
    Response,
    SessionRow,
    Study,
    Trial,
)
from app.study.protocol import Stage, position

from . import studies
from .state import ENDED, read_progress
from .studio import Studio

#: A response brings one pair; the pairs of the other two responses were loaded for nothing.
PAIRS_LOADED_PER_QUERY = 3

MODES = ("live", "preview", "simulated")


@dataclass(frozen=True)
class SessionLine:
    """One session in a study's list."""

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


@dataclass(frozen=True)
class Counts:
    """How many sessions of one mode stand where."""

    active: int = 0
    completed: int = 0
    withdrawn: int = 0
    declined: int = 0
    screened_out: int = 0

    @property
    def total(self) -> int:
        ended = self.completed + self.withdrawn + self.declined + self.screened_out
        return self.active + ended


def payload_mb(studio: Studio, study: studies.StudyInfo) -> float | None:
    """Megabytes of video that one session loads at the most: each pair, and those preloaded.

    From the videos that are there already; None if none is.
    """
    clips = [
        clip
        for environment in study.plan.environments
        for clip in studio.proposer.space(study.id, environment).all_clips
    ]
    paths = [path for clip in clips if (path := studio.recordings.ready_path(clip)) is not None]
    if not paths:
        return None
    mean_bytes = sum(path.stat().st_size for path in paths) / len(paths)
    pairs = study.plan.trials * study.plan.shown_per_trial * PAIRS_LOADED_PER_QUERY
    blocks = study.plan.trials // study.plan.trials_per_block
    return (2 * pairs + blocks * study.plan.familiarisation.videos) * mean_bytes / 1e6


def sessions(studio: Studio, slug: str, mode: str | None) -> list[SessionLine]:
    """The sessions of a study in one mode (None: all), the newest first."""
    answered = (
        select(
            Trial.session_id,
            func.count(Response.id).label("answered"),
            func.count(Trial.id.distinct()).label("trials"),
            func.sum(case((Response.response == "skip", 1), else_=0)).label("skips"),
        )
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(Response, Response.query_id == QueryRow.id)
        .where(Trial.trial_index >= 0)
        .group_by(Trial.session_id)
        .subquery()
    )
    study = studies.find(studio, slug)
    statement = (
        select(
            SessionRow,
            Participant.pseudonym,
            answered.c.answered,
            answered.c.skips,
            answered.c.trials,
        )
        .join(Participant, SessionRow.participant_id == Participant.id)
        .outerjoin(answered, answered.c.session_id == SessionRow.id)
        .where(SessionRow.study_id == study.id)
        .order_by(SessionRow.started_at.desc(), SessionRow.id.desc())
    )
    if mode is not None:
        statement = statement.where(SessionRow.mode == mode)
    with studio.database.read() as session:
        lines = []
        for row, pseudonym, responses, skips, begun in session.execute(statement):
            where = position(studies.stored_plan(row.plan), read_progress(row))
            if row.stage == Stage.WITHDRAWN and begun:
                # Who left has no place in the protocol any more: where the last answer was given.
                before = (begun - 1) * where["queries"]
                where = {**where, "trial": begun, "query": responses - before}
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
                    **where,
                )
            )
        return lines


def deleted(studio: Studio, slug: str, mode: str | None) -> int:
    """How many sessions of one mode (None: all) were deleted at their person's wish."""
    statement = (
        select(func.count(Tombstone.id))
        .join(Study, Tombstone.study_id == Study.id)
        .where(Study.slug == slug)
    )
    if mode is not None:
        statement = statement.where(Tombstone.mode == mode)
    with studio.database.read() as session:
        return session.scalar(statement) or 0


def counts(studio: Studio) -> Mapping[tuple[str, str], Counts]:
    """By (slug, mode): how many sessions stand where."""
    with studio.database.read() as session:
        rows = session.execute(
            select(Study.slug, SessionRow.mode, SessionRow.stage, func.count(SessionRow.id))
            .join(Study, SessionRow.study_id == Study.id)
            .group_by(Study.slug, SessionRow.mode, SessionRow.stage)
        ).all()
    by_place: dict[tuple[str, str], Counter[str]] = {}
    for slug, mode, stage, number in rows:
        place = stage if Stage(stage).value in ENDED else "active"
        by_place.setdefault((slug, mode), Counter())[place] += number
    return {key: Counts(**found) for key, found in by_place.items()}
