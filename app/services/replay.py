"""A study's trials worked out again from what was stored: does every query come out alike?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session, selectinload

from app.storage.tables import SessionRow, Trial
from app.study.stages import PRACTICE_INDEX

from . import queries, studies
from .course import following, learned
from .proposals import work_out
from .studio import Studio


@dataclass(frozen=True)
class Difference:
    """A stored query that the optimiser would not propose today."""

    query_index: int
    stored: tuple[int, int, int, int]
    proposed: tuple[int, int, int, int]


@dataclass(frozen=True)
class Replayed:
    """One trial, replayed."""

    session_id: str
    trial_index: int
    condition: str
    queries: int
    differences: tuple[Difference, ...]


def replay(studio: Studio, slug: str) -> Iterator[Replayed]:
    """Replay every trial of a study, query by query, from candidates, history and seed alone."""
    study = studies.find(studio, slug)
    with studio.database.read() as session:
        stored = session.scalars(
            select(Trial)
            .join(SessionRow, Trial.session_id == SessionRow.id)
            .where(SessionRow.study_id == study.id, Trial.trial_index != PRACTICE_INDEX)
            .order_by(SessionRow.id, Trial.trial_index)
            .options(selectinload(Trial.queries))
        )
        for trial in stored:
            yield Replayed(
                session_id=trial.session.public_id,
                trial_index=trial.trial_index,
                condition=trial.condition,
                queries=len(trial.queries),
                differences=tuple(_differences(studio, session, trial)),
            )


def _differences(studio: Studio, session: Session, trial: Trial) -> Iterator[Difference]:
    in_hand = queries.trial_in_hand(trial.session, trial.trial_index, trial.seed)
    space = studio.proposer.space(in_hand.study_id, in_hand.environment)
    record = queries.read_record(session, trial.id)
    for query in trial.queries:
        if query.attempt > 0:
            # What took the place of a video that did not play depends on which ones could be had.
            continue
        before = record[: query.query_index]
        step = work_out(space, in_hand, learned(in_hand, before))
        proposal = following(space, in_hand, before, step)
        assert proposal is not None
        stored = (
            query.left_candidate,
            query.right_candidate,
            query.left_recording_id,
            query.right_recording_id,
        )
        proposed = (
            proposal.left_candidate,
            proposal.right_candidate,
            proposal.left.id,
            proposal.right.id,
        )
        if stored != proposed:
            yield Difference(query.query_index, stored, proposed)
