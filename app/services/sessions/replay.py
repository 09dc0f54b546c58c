"""Computes a study's trials again from the stored responses, and compares the results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session, selectinload

from app.services.context import AppContext
from app.services.proposals.proposer import ProposedQuery, next_step
from app.services.proposals.trial_schedule import (
    is_training,
    next_query,
    training_history,
    training_records,
)
from app.services.studies import repository
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow, SessionRow, Trial
from app.study.stage_settings import PRACTICE_INDEX

from . import box_replay, early_end, queries, shared_replay
from .derived_rows import preferences
from .shared_replay import SharedReplay


@dataclass(frozen=True)
class Difference:
    """A stored value that the computation does not reproduce.

    what: a query (candidates and recordings, left and right), the candidate acquired after a query,
    the query after which the trial was sure enough to end, or the trial's preferences
    (index, winner, loser, origin, queries; those that differ).
    """

    what: str
    stored: tuple[Any, ...]
    worked_out: tuple[Any, ...]


@dataclass(frozen=True)
class Replayed:
    """The result for one trial."""

    session_id: str
    trial_index: int
    condition: str
    queries: int
    #: Responses that were judged on recordings withdrawn since, and are not learnt from.
    withdrawn: int
    differences: tuple[Difference, ...]
    #: Queries and acquired candidates of a shared model that cannot be computed again, because
    #: answers that they were computed from were deleted or taken back since.
    gone: int = 0
    #: Those that are not computed again, because their trial began under a version of the engine
    #: whose steps differ.
    earlier: int = 0


def replay(app: AppContext, slug: str) -> Iterator[Replayed]:
    """Replay every trial of a study, query by query, from candidates, responses and seed alone."""
    study = repository.find(app, slug)
    with app.database.read() as db:
        stored = db.scalars(
            select(Trial)
            .join(SessionRow, Trial.session_id == SessionRow.id)
            .where(SessionRow.study_id == study.id, Trial.trial_index != PRACTICE_INDEX)
            .order_by(SessionRow.id, Trial.trial_index)
            .options(selectinload(Trial.queries))
        )
        for trial in stored:
            shared = shared_replay.trial_of(trial)
            found = SharedReplay()
            if shared is not None:
                found = shared_replay.replay(app, db, trial, shared)
            yield Replayed(
                session_id=trial.session.public_id,
                trial_index=trial.trial_index,
                condition=trial.condition,
                queries=len(trial.queries),
                withdrawn=box_replay.withdrawn(trial),
                differences=(
                    tuple(_differences(app, db, trial))
                    if shared is None
                    else tuple(Difference(*one) for one in found.differences)
                ),
                gone=found.gone,
                earlier=found.earlier,
            )


def _differences(app: AppContext, db: Session, trial: Trial) -> Iterator[Difference]:
    if repository.stored_plan(trial.session.plan).has_ranges:
        for one in box_replay.differences(db, trial):
            yield Difference(one.what, one.stored, one.computed)
        return
    spec = queries.trial_spec(
        trial.session, trial.trial_index, trial.seed, trial.queries[0].engine_version
    )
    if spec.sure is None:
        # Not compared, and half of the work.
        spec = replace(spec, within=None)
    candidate_set = app.proposer.candidate_set(spec.study_id, spec.environment)
    record = queries.read_record(db, trial.id)
    # A replacement for a video that did not play depends on which recordings were available.
    asked = {query.query_index: query for query in trial.queries if query.attempt == 0}
    acquired: dict[int, int] = {}
    sure: list[int] = []
    for place in range(len(record) + 1):
        before = record[:place]
        step = next_step(candidate_set, spec, training_history(spec, before))
        if place > 0 and step.acquired and is_training(spec, before[-1].trial_type):
            acquired[place - 1] = step.acquired.candidate
            sure += [place - 1] if spec.is_sure(step.acquired) else []
        if place in asked:
            proposal = next_query(candidate_set, spec, before, step)
            assert proposal is not None
            was, would_be = _shown(asked[place]), _proposed(proposal)
            if was != would_be:
                yield Difference(f"query {place}", was, would_be)
    ended = early_end.difference(trial, spec, len(record), sure)
    if ended is not None:
        yield Difference(early_end.WHAT, ended[:1], ended[1:])
    stored = _acquired(db, trial)
    for place in sorted(acquired.keys() | stored.keys()):
        if stored.get(place) != acquired.get(place):
            pair = ((stored.get(place),), (acquired.get(place),))
            yield Difference(f"acquired after query {place}", *pair)
    kept = _preferences(db, trial)
    computed = {tuple(row.values()) for row in preferences(step, training_records(spec, record))}
    if kept != computed:
        yield Difference(
            "preferences", tuple(sorted(kept - computed)), tuple(sorted(computed - kept))
        )


def _acquired(db: Session, trial: Trial) -> dict[int, int]:
    columns = (Acquired.query_index, Acquired.candidate)
    rows = db.execute(select(*columns).where(Acquired.trial_id == trial.id))
    return {row.query_index: row.candidate for row in rows}


def _preferences(db: Session, trial: Trial) -> set[tuple[Any, ...]]:
    rows = db.execute(
        select(
            PreferenceRow.preference_index,
            PreferenceRow.winner,
            PreferenceRow.loser,
            PreferenceRow.origin,
            PreferenceRow.query_index,
            PreferenceRow.drawn_from_query_index,
        ).where(PreferenceRow.trial_id == trial.id)
    )
    return {tuple(row) for row in rows}


def _shown(query: QueryRow) -> tuple[int | None, ...]:
    return (
        query.left_candidate,
        query.right_candidate,
        query.left_recording_id,
        query.right_recording_id,
    )


def _proposed(query: ProposedQuery) -> tuple[int, ...]:
    return (query.left_candidate, query.right_candidate, query.left.id, query.right.id)
