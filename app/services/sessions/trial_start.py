"""The start of a trial: its row, its seed and its first query."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals import practice_pairs
from app.services.proposals.proposer import ProposedQuery, RecordingRef, TrialSpec
from app.services.runtime.ids import new_public_id
from app.services.studies import repository
from app.storage.models.studies import QueryRow, SessionRow, Trial
from app.study.stage_settings import PRACTICE, PRACTICE_INDEX
from app.study.stages import Stage

from . import (
    box_queries,
    box_trials,
    familiarisation,
    queries,
    shared_ahead,
    shared_next,
    shared_trials,
)
from .shared_trials import SharedTrial


def enter_stage(app: AppContext, db: Session, session: SessionRow) -> None:
    """Prepare the stage that the session has entered: its trial and first query, or its videos."""
    if session.stage == Stage.QUERY:
        _begin(app, db, session)
    elif session.stage == Stage.PRACTICE:
        _begin_practice(app, db, session)
    elif session.stage in (Stage.BREAK, Stage.FAMILIARISATION):
        if repository.stored_plan(session.plan).has_ranges:
            box_queries.ask_first_ahead(app, db, session, first_spec(session))
            return
        # Rendered ahead, so that the first pair is ready when the person continues.
        coming = prepare_first(app, db, session)
        plan = repository.plan_of(session)
        if plan.familiarises_before(session.trial_index):
            coming = [*familiarisation.videos(app, session), *coming]
        app.proposer.render(coming)


def _begin(app: AppContext, db: Session, session: SessionRow) -> None:
    """Store the trial that the session has entered, with its first query."""
    spec = first_spec(session)
    box = box_trials.trial_of(session, spec)
    shared = shared_trials.trial_of(session, session.trial_index, spec)
    first = None
    if shared is not None:
        first, proposed_from = _first_shared(app, db, shared)
    elif box is None:
        first = first_query(app, session)
    condition = repository.stored_plan(session.plan).conditions[
        session.trial_conditions[session.trial_index]
    ]
    now = app.now()
    trial = Trial(
        session_id=session.id,
        trial_index=session.trial_index,
        condition=condition.name,
        method=condition.method,
        environment=condition.environment,
        seed=queries.trial_seed(session, session.trial_index),
        started_at=now,
        queries=[] if first is None else [query_row(first, now)],
    )
    if shared is not None:
        trial.queries[0].proposed_from = proposed_from
    db.add(trial)
    db.flush()
    if box is not None:
        box_queries.open_first(app, db, box, trial.id)
    elif first is not None:
        app.proposer.render([first.left, first.right])


def _first_shared(
    app: AppContext, db: Session, trial: SharedTrial
) -> tuple[ProposedQuery, dict[str, Any]]:
    """The first query under a shared model, which may know much by then, and its sources.

    Raises StepNeededError.
    """
    shared_trials.lock(db, trial)
    moment = shared_trials.read_moment(db, trial, app.now())
    step = shared_next.after(app, trial, 0, moment, None)
    assert step.proposal is not None
    known = [*(answer.id for answer in moment.answers), *moment.gone]
    sources = shared_trials.sources(trial, step.used, known, step.avoided)
    return step.proposal, sources.as_json()


def _begin_practice(app: AppContext, db: Session, session: SessionRow) -> None:
    """Store the practice trial, with its first query."""
    now = app.now()
    trial = Trial(
        session_id=session.id,
        trial_index=PRACTICE_INDEX,
        condition=PRACTICE,
        method="random",
        environment=queries.trial_spec(session, PRACTICE_INDEX, 0).environment,
        seed=queries.trial_seed(session, PRACTICE_INDEX),
        started_at=now,
    )
    first = practice_query(app, session, 0)
    trial.queries.append(query_row(first, now))
    db.add(trial)
    db.flush()
    app.proposer.render([first.left, first.right, *prepare_first(app, db, session)])


def practice_query(app: AppContext, session: SessionRow, query_index: int) -> ProposedQuery:
    """The practice query with this index."""
    spec = queries.trial_spec(session, PRACTICE_INDEX, queries.trial_seed(session, PRACTICE_INDEX))
    candidate_set = app.proposer.candidate_set(spec.study_id, spec.environment)
    return practice_pairs.pair(candidate_set, spec.seed, query_index)


def first_query(app: AppContext, session: SessionRow) -> ProposedQuery:
    """The first query of the session's current trial. It is random, so no model is fitted."""
    first = app.proposer.step(first_spec(session), ()).next
    assert first is not None
    return first


def prepare_first(app: AppContext, db: Session, session: SessionRow) -> list[RecordingRef]:
    """The recordings of the first pair of the session's current trial, to be rendered.

    None under a shared model: the pair depends on what it knows, and is computed and rendered in
    the background.
    """
    shared = shared_trials.trial_of(session, session.trial_index, first_spec(session))
    if shared is not None:
        shared_ahead.prepare_first(app, db, shared)
        return []
    first = first_query(app, session)
    return [first.left, first.right]


def first_spec(session: SessionRow) -> TrialSpec:
    """The specification of the session's current trial, which begins now or later."""
    return queries.trial_spec(
        session, session.trial_index, queries.trial_seed(session, session.trial_index)
    )


def query_row(
    following: ProposedQuery, now: datetime, trial_id: int | None = None, attempt: int = 0
) -> QueryRow:
    """A query's row, not yet added to a transaction."""
    return QueryRow(**query_columns(following, now, trial_id, attempt))


def query_columns(
    following: ProposedQuery, now: datetime, trial_id: int | None = None, attempt: int = 0
) -> dict[str, Any]:
    """The columns of a query that is asked now."""
    return {
        "trial_id": trial_id,
        "public_id": new_public_id(),
        "query_index": following.query_index,
        "attempt": attempt,
        "trial_type": following.trial_type,
        "left_candidate": following.left_candidate,
        "right_candidate": following.right_candidate,
        "left_recording_id": following.left.id,
        "right_recording_id": following.right.id,
        "acquisition": following.acquisition,
        "seed": following.seed,
        "engine_version": following.engine_version,
        "repeats_query_index": following.repeats,
        "created_at": now,
        "shown_at": now,
    }
