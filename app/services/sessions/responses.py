"""Stores a response with the query that follows it.

Both in one transaction, so a second tab, a double click or a retry finds it done.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session
from sqlalchemy.orm.attributes import set_committed_value

from app.pbbo import allows_skip
from app.services.context import AppContext
from app.services.proposals.computation import History
from app.services.proposals.proposer import NextStep, ProposedQuery, TrialSpec
from app.services.proposals.trial_schedule import (
    AnsweredQueries,
    AskedQuery,
    check_at,
    is_training,
    next_query,
    training_history,
    training_records,
)
from app.services.rollouts import requests
from app.services.runtime.errors import (
    ConflictError,
    SkipNotOfferedError,
)
from app.services.studies.repository import stored_plan
from app.storage.bulk_insert import insert_rows
from app.storage.models.studies import QueryRow, Response, SessionRow
from app.study import stages
from app.study.stage_settings import PRACTICE_INDEX
from app.study.stages import Stage

from . import (
    answers,
    box_next,
    box_queries,
    box_settling,
    box_trials,
    box_withdrawal,
    candidate_rows,
    derived_rows,
    event_limits,
    lookup,
    queries,
    shared_next,
    shared_queries,
    shared_trials,
    trial_start,
)
from . import state_view as session_state
from .answers import Answer
from .box_next import Computed, Following
from .box_trials import BoxTrial
from .queries import OpenQuery
from .shared_trials import SharedTrial, Sources
from .state_view import State


@dataclass(frozen=True)
class _ResponseContext:
    """The trial and history of the query that is answered.

    record: the trial's answered queries, this one included.
    """

    trial: TrialSpec
    record: AnsweredQueries
    is_practice: bool

    @property
    def history(self) -> History:
        return training_history(self.trial, self.record)


@dataclass(frozen=True)
class _StepNeeded:
    """The step after this history has to be computed before the response can be stored."""

    trial: TrialSpec
    history: History


@dataclass(frozen=True)
class _ComputationNeeded:
    """The same in a study over ranges."""

    following: Following


@dataclass(frozen=True)
class _Stored:
    """The response is stored. opened: the query that follows in the same trial; session: its."""

    opened: OpenQuery | None = None
    session: SessionRow | None = None


def respond(app: AppContext, token: str, answer: Answer) -> State:
    """Store a response with the query that follows it. Sent again, it changes nothing.

    If the step after it is cached, as it almost always is, one writing transaction reads, checks
    and stores. Otherwise that transaction only reads; the step is computed outside any transaction,
    and a second one stores it. The state is described from the values at hand.
    """
    with app.metrics.answering(answer.response):
        attempt = shared_next.computing(app, lambda: _attempt(app, token, answer, None))
        if isinstance(attempt, _StepNeeded):
            step = app.proposer.step(attempt.trial, attempt.history)
            # The history is still valid: undoing an earlier response would have deleted this query.
            attempt = shared_next.computing(app, lambda: _attempt(app, token, answer, step))
            assert not isinstance(attempt, _StepNeeded)
        for _ in range(box_settling.MOST_ROUNDS):
            if isinstance(attempt, _ComputationNeeded):
                computed = box_next.compute(app.proposer.boxes, attempt.following)
                attempt = _attempt(app, token, answer, None, computed)
                assert not isinstance(attempt, _StepNeeded)
        if isinstance(attempt, _ComputationNeeded):
            raise ConflictError("expected what is excluded to settle; send the response again")
        with app.database.read() as db:
            session = attempt.session or lookup.find(app, db, token)
            return session_state.describe(app, db, session, attempt.opened)


def _attempt(
    app: AppContext,
    token: str,
    answer: Answer,
    step: NextStep | None,
    computed: Computed | None = None,
) -> _StepNeeded | _ComputationNeeded | _Stored:
    """Store a response and what follows, or write nothing if its step is neither given nor cached.

    step: the step after the response, if it was computed for it. computed: the same in a study over
    ranges.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        query = queries.find(db, session, answer.query_id)
        if not answers.is_new(session, query, answer):
            return _Stored()
        asked = _read(db, session, query, answer)
        if stored_plan(session.plan).has_ranges:
            return _attempt_over_space(app, db, session, query, answer, asked, computed)
        shared = shared_trials.trial_of(session, query.trial.trial_index, asked.trial)
        if shared is not None:
            opened = _store_shared(app, db, session, query, answer, asked, shared)
            return _Stored(opened, session if opened is not None else None)
        if not asked.is_practice:
            is_computed = step is not None
            step = step or app.proposer.cached_step(asked.trial, asked.history)
            if step is None:
                return _StepNeeded(asked.trial, asked.history)
            app.metrics.step_asked(ahead=not is_computed)
        opened = _store(app, db, session, query, answer, asked, step)
    return _Stored(opened, session if opened is not None else None)


def _attempt_over_space(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: QueryRow,
    answer: Answer,
    asked: _ResponseContext,
    given: Computed | None,
) -> _ComputationNeeded | _Stored:
    """The same for a search space given by ranges, whose videos machines record.

    given: what follows the response, if it was computed for it. It is computed again if what is
    excluded has changed meanwhile.
    """
    trial = box_trials.trial_of(session, asked.trial)
    assert trial is not None
    box_withdrawal.mark_if_withdrawn(db, query, app.now())
    following = box_queries.read_following(db, trial, query.trial_id, asked.record)
    is_given = given is not None and given.following == following
    computed = given if is_given else box_next.cached(app.proposer.boxes, following)
    if computed is None:
        return _ComputationNeeded(following)
    app.metrics.step_asked(ahead=not is_given)
    _store_over_space(app, db, session, query, answer, asked, trial, computed)
    return _Stored()


def _store_over_space(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: QueryRow,
    answer: Answer,
    asked: _ResponseContext,
    trial: BoxTrial,
    computed: Computed,
) -> None:
    """Write the response, its derived rows and the next query, and ask for its videos."""
    is_training_one = is_training(asked.trial, query.trial_type)
    acquired = None if computed.acquired is None else computed.acquired.acquired
    is_sure = is_training_one and asked.trial.is_sure(acquired)
    now = _write_response(app, db, session, query, answer, is_sure=is_sure)
    candidates = candidate_rows.find_or_add(db, trial, computed.points)
    if is_training_one:
        box_queries.store_derived(db, query, computed, candidates, asked.record)
    if session.stage == Stage.QUERY and session.trial_index == query.trial.trial_index:
        box_queries.open_following(db, trial, query.trial_id, computed, candidates, now)
        return
    query.trial.ended_at = now
    requests.take_back(db, query.trial_id, (), now)
    trial_start.enter_stage(app, db, session)


def _store_shared(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: QueryRow,
    answer: Answer,
    asked: _ResponseContext,
    trial: SharedTrial,
) -> OpenQuery | None:
    """`_store` under a model that several people share. Raises StepNeededError."""
    shared_trials.lock(db, trial)
    moment = shared_trials.read_moment(db, trial, app.now())
    place = len(asked.record)
    own = None
    if is_training(asked.trial, query.trial_type):
        own = shared_trials.answer_to(trial, asked.record[-1])
    step = shared_next.after(app, trial, place, moment, own)
    is_sure = own is not None and asked.trial.is_sure(step.acquired)
    now = _write_response(app, db, session, query, answer, is_sure=is_sure)
    sources = shared_queries.store_derived(db, trial, query, step, moment, own, asked.record)
    if session.stage == Stage.QUERY and session.trial_index == query.trial.trial_index:
        candidate_set = app.proposer.candidate_set(asked.trial.study_id, asked.trial.environment)
        if step.proposal is None:
            check = check_at(candidate_set, asked.trial, asked.record, place)
            return _open(db, query, check, asked.record, now)
        return _open(db, query, step.proposal, asked.record, now, sources)
    query.trial.ended_at = now
    trial_start.enter_stage(app, db, session)
    return None


def _read(db: Session, session: SessionRow, query: QueryRow, answer: Answer) -> _ResponseContext:
    """Read the context of a response.

    Raises OutOfOrder, SkipNotOfferedError or SkipReasonError if the response cannot be accepted.
    """
    lookup.require_asked(session, query.query_index)
    trial = queries.trial_spec(
        session, query.trial.trial_index, query.trial.seed, query.engine_version
    )
    if answer.response == "skip" and not allows_skip(trial.method):
        raise SkipNotOfferedError(
            "expected left or right: this query offers no skip", session.stage
        )
    answers.check_reason(session, query, answer)
    is_practice = query.trial.trial_index == PRACTICE_INDEX
    before = () if is_practice else queries.read_record(db, query.trial_id)
    return _ResponseContext(trial, (*before, answers.answered(query, answer)), is_practice)


def _store(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: QueryRow,
    answer: Answer,
    asked: _ResponseContext,
    step: NextStep | None,
) -> OpenQuery | None:
    """Write the response, its derived rows and the next query; return that query, if there is one.

    Raises OutOfOrder, before anything is written, if the session's open query is another one.
    """
    is_training_one = is_training(asked.trial, query.trial_type)
    acquired = None if step is None else step.acquired
    is_sure = is_training_one and asked.trial.is_sure(acquired)
    now = _write_response(app, db, session, query, answer, is_sure=is_sure)
    if step is None:
        _continue_practice(app, db, session, query, now)
        return None
    if is_training_one:
        derived_rows.store(db, query, step, training_records(asked.trial, asked.record))
    if session.stage == Stage.QUERY and session.trial_index == query.trial.trial_index:
        candidate_set = app.proposer.candidate_set(asked.trial.study_id, asked.trial.environment)
        proposal = next_query(candidate_set, asked.trial, asked.record, step)
        assert proposal is not None
        return _open(db, query, proposal, asked.record, now)
    query.trial.ended_at = now
    trial_start.enter_stage(app, db, session)
    return None


def _write_response(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: QueryRow,
    answer: Answer,
    *,
    is_sure: bool = False,
) -> datetime:
    """Advance the session and write the response with its client events; the time of both.

    is_sure: whether this response ends its trial early.
    """
    now = app.now()
    responded = stages.Responded(query_index=query.query_index, at=now, is_sure=is_sure)
    lookup.advance(app, session, responded)
    given = {
        "query_id": query.id,
        "response": answer.response,
        "skip_reason": answer.skip_reason,
        "rt_ms": answer.rt_ms,
        "answered_at": now,
        "plan_id": session.plan_id,
    }
    insert_rows(db, Response, [given])
    set_committed_value(query, "response", Response(**given))
    event_limits.store(db, session, query, answer.client_events, answer.left_out, now)
    return now


def _open(
    db: Session,
    answered: QueryRow,
    proposal: ProposedQuery,
    record: AnsweredQueries,
    now: datetime,
    sources: Sources | None = None,
) -> OpenQuery:
    """Store the trial's next query. record: the answered queries before it. sources: what a shared
    model proposed it from."""
    trial = answered.trial
    asked = trial_start.query_columns(proposal, now, trial_id=trial.id)
    if sources is not None:
        asked["proposed_from"] = sources.as_json()
    insert_rows(db, QueryRow, [asked])
    return OpenQuery(
        trial_id=trial.id,
        trial_index=trial.trial_index,
        environment=trial.environment,
        seed=trial.seed,
        public_id=asked["public_id"],
        attempt=asked["attempt"],
        asked=AskedQuery(
            query_index=proposal.query_index,
            trial_type=proposal.trial_type,
            left=proposal.left_candidate,
            right=proposal.right_candidate,
            left_recording=proposal.left.id,
            right_recording=proposal.right.id,
            acquisition=proposal.acquisition,
            engine_version=proposal.engine_version,
            repeats=proposal.repeats,
            response=None,
        ),
        record=record,
        just_answered=answered,
    )


def _continue_practice(
    app: AppContext, db: Session, session: SessionRow, query: QueryRow, now: datetime
) -> None:
    if session.stage == Stage.PRACTICE:
        proposal = trial_start.practice_query(app, session, session.query_index)
        db.add(trial_start.query_row(proposal, now, trial_id=query.trial_id))
    else:
        query.trial.ended_at = now
        trial_start.enter_stage(app, db, session)
