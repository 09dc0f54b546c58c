"""The open query in STATE: two videos, and how the query may be answered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals import practice_pairs
from app.services.proposals.proposer import ProposedQuery, RecordingRef, TrialSpec
from app.services.proposals.trial_schedule import check_at, is_training, kind_at, training_history
from app.services.recordings.addresses import Place
from app.services.recordings.recordings import video_url
from app.services.studies.repository import stored_plan
from app.storage.models.studies import SessionRow
from app.study.attention_checks import Kind
from app.study.plan import Condition, Plan
from app.study.query_settings import reasons_in
from app.study.stage_settings import PRACTICE_INDEX
from app.study.stages import Stage

from . import hidden_checks, queries, shared_ahead, shared_trials, undo_window
from .queries import OpenQuery


def describe(
    app: AppContext, db: Session, session: SessionRow, known: OpenQuery | None = None
) -> dict[str, Any]:
    """The `query` of STATE. Keys of features that the study does not use are absent.

    known: the open query, if the caller has it at hand; otherwise it is read.
    """
    plan = stored_plan(session.plan)
    practising = session.stage == Stage.PRACTICE
    trial_index = PRACTICE_INDEX if practising else session.trial_index
    trial = known or queries.load_open_query(db, session, trial_index)
    query = trial.asked
    candidate_set = app.proposer.candidate_set(session.study_id, trial.environment)
    condition = plan.conditions[session.trial_conditions[session.trial_index]]
    place = (trial_index, query.query_index)
    coming, then = _coming(app, db, session, trial), _place_after(session, trial)
    clips = [clip for following in coming for clip in (following.left, following.right)]
    if clips and not practising:
        clips = hidden_checks.padded(clips, session, trial, candidate_set)
    state: dict[str, Any] = {
        "id": trial.public_id,
        "left": video(
            app, session, candidate_set.recording(query.left, query.left_recording), place
        ),
        "right": video(
            app, session, candidate_set.recording(query.right, query.right_recording), place
        ),
        "skip": skip_of(plan, condition, session.language, session.skip_reason_order),
        "prefetch": list(dict.fromkeys(address(app, session, clip, then) for clip in clips)),
    }
    if practising:
        state["practice"] = True
    return state | options(app, db, session, trial)


def options(app: AppContext, db: Session, session: SessionRow, trial: OpenQuery) -> dict[str, Any]:
    """The optional keys of `query`: an undo that is offered now, and whether to watch once."""
    state: dict[str, Any] = {}
    if undo := undo_offer(app, db, session, trial):
        state["undo"] = undo
    if stored_plan(session.plan).query.watch_once:
        state["watch_once"] = True
    return state


def undo_offer(
    app: AppContext, db: Session, session: SessionRow, trial: OpenQuery
) -> dict[str, str | float] | None:
    """The `undo` of STATE, or None: the query whose response may be undone, and seconds left."""
    offer = undo_window.find(db, session, trial, app.now())
    seconds_left = round(offer.seconds_left, 1) if offer is not None else 0.0
    if offer is None or seconds_left <= 0:
        return None
    return {"query_id": offer.query.public_id, "seconds_left": seconds_left}


def video(app: AppContext, session: SessionRow, clip: RecordingRef, place: Place) -> dict[str, Any]:
    """A recording in STATE: its URL for this session and place, and its duration."""
    return {"url": address(app, session, clip, place), "duration_s": clip.duration_s}


def address(app: AppContext, session: SessionRow, clip: RecordingRef, place: Place) -> str:
    """The URL of a recording for this session and place."""
    return app.settings.root_path + video_url(app.addresses.of(session, clip.id, place))


def skip_of(
    plan: Plan, condition: Condition, language: str, order: Sequence[str] | None = None
) -> dict[str, Any] | None:
    """The skip button of a condition in one language; None if the condition offers no skip.

    order: names of reasons, in the order of the session's pages; None: as in the plan.
    """
    skip = condition.skip
    if skip is None:
        return None
    state: dict[str, Any] = {"label": plan.text(skip.label, language)}
    if skip.reasons:
        state["reasons"] = [
            {"name": name, "label": plan.text(skip.reasons[name], language)}
            for name in reasons_in(order, skip)
        ]
    return state


def _coming(
    app: AppContext, db: Session, session: SessionRow, trial: OpenQuery
) -> list[ProposedQuery]:
    """Candidates for the next query, most likely first, as far as they are computed."""
    spec = queries.trial_spec(session, trial.trial_index, trial.seed, trial.asked.engine_version)
    if trial.trial_index == PRACTICE_INDEX:
        return _after_practice(app, session, spec)
    record, query = trial.record, trial.asked
    kind = kind_at(spec, query.query_index + 1)
    history = training_history(spec, record)
    pair = (query.left, query.right)
    coming = []
    shared = shared_trials.trial_of(session, trial.trial_index, spec)
    if shared is not None:
        coming = shared_ahead.prepare(app, db, shared, trial)
    elif is_training(spec, query.trial_type):
        coming = app.proposer.possible_queries(spec, history, pair)
        app.proposer.precompute(spec, history, pair)
    elif (known := app.proposer.cached_step(spec, history)) and known.next:
        coming = [known.next]
    # The step after the last query has no next query, but its derived rows are still needed.
    if kind in (None, Kind.MODEL):
        return coming
    candidate_set = app.proposer.candidate_set(spec.study_id, spec.environment)
    check = check_at(candidate_set, spec, record, query.query_index + 1)
    app.proposer.render([check.left, check.right])
    return [check]


def _place_after(session: SessionRow, trial: OpenQuery) -> Place:
    """The place at which the query after the open one will be shown."""
    is_last = session.query_index + 1 >= stored_plan(session.plan).practice.queries
    if trial.trial_index == PRACTICE_INDEX and is_last:
        return (0, 0)
    return (trial.trial_index, trial.asked.query_index + 1)


def _after_practice(app: AppContext, session: SessionRow, spec: TrialSpec) -> list[ProposedQuery]:
    """The query after the open practice query, which does not depend on the response.

    Empty before a trial under a shared model, whose first pair is not known yet.
    """
    if session.query_index + 1 < stored_plan(session.plan).practice.queries:
        candidate_set = app.proposer.candidate_set(spec.study_id, spec.environment)
        return [practice_pairs.pair(candidate_set, spec.seed, session.query_index + 1)]
    of_first = queries.trial_spec(session, 0, queries.trial_seed(session, 0))
    if shared_trials.trial_of(session, 0, of_first) is not None:
        return []
    first = app.proposer.step(of_first, ()).next
    assert first is not None
    return [first]
