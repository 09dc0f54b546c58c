"""Withdraws recordings after they were judged: their responses leave the model.

The responses stay in the record. What was derived from them is derived anew in the same
transaction, in trials that have ended too: the preferences, and the candidate acquired last. What
was acquired before that stays, with what it was computed from.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from datetime import datetime
from typing import TypeVar

from sqlalchemy import delete, exists, or_, select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.proposals.box_steps import BoxRequest
from app.services.rollouts import interventions, outcomes, states
from app.services.runtime.errors import ConflictError
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Acquired, QueryRow, SessionRow, Trial

from . import box_next, box_trials, candidate_rows, derived_rows, queries
from .box_settling import MOST_ROUNDS
from .box_trials import Sources

Result = TypeVar("Result")


class _ComputationNeededError(Exception):
    """Candidates have to be computed before the transaction can be repeated."""

    def __init__(self, requests: Sequence[BoxRequest]) -> None:
        super().__init__(f"{len(requests)} candidates")
        self.requests = requests


def withdraw(
    app: AppContext, slug: str, public_id: str, reason: str, actor: str = audit_log.COMMAND_LINE
) -> int:
    """Withdraw a recorded rollout; return the number of responses that leave the model.

    Raises NotFoundError, or ConflictError if the rollout is not recorded or no reason is given.
    """
    said = interventions.checked_reason(reason)

    def act(db: Session) -> int:
        rollout = interventions.found(db, slug, public_id)
        number = _withdraw(app, db, [rollout.id], said)
        details = {"rollout": public_id, "reason": reason, "responses": number}
        audit_log.note(db, app.now(), actor, "rollout withdrawn", slug, **details)
        return number

    return _in_one_transaction(app, act)


def withdraw_machine(
    app: AppContext,
    slug: str,
    name: str,
    since: datetime,
    reason: str,
    actor: str = audit_log.COMMAND_LINE,
) -> tuple[int, int]:
    """Withdraw what a machine has recorded since a time, as when it was found to be miscalibrated.

    Returns the numbers of rollouts and of responses that leave the model. Raises NotFoundError, or
    ConflictError if no reason is given.
    """
    said = interventions.checked_reason(reason)

    def act(db: Session) -> tuple[int, int]:
        rollouts = outcomes.recorded_by(db, interventions.machine_named(db, slug, name).id, since)
        number = _withdraw(app, db, rollouts, said)
        details = {
            "machine": name,
            "since": since.isoformat(),
            "reason": reason,
            "rollouts": len(rollouts),
            "responses": number,
        }
        audit_log.note(db, app.now(), actor, "machine's rollouts withdrawn", slug, **details)
        return len(rollouts), number

    return _in_one_transaction(app, act)


def mark_if_withdrawn(db: Session, query: QueryRow, now: datetime) -> None:
    """Keep the model from learning of a query whose recordings were withdrawn while it was shown.

    Called before its response is stored.
    """
    rollouts = (query.left_rollout_id, query.right_rollout_id)
    is_withdrawn = select(Rollout.id).where(
        Rollout.id.in_(rollouts), Rollout.status == states.WITHDRAWN
    )
    if query.withdrawn_at is None and db.scalar(is_withdrawn.limit(1)) is not None:
        query.withdrawn_at = now
        db.flush()


def _in_one_transaction(app: AppContext, act: Callable[[Session], Result]) -> Result:
    """Carry out `act`; what it needs computed is computed between two tries."""
    for _ in range(MOST_ROUNDS):
        try:
            with app.database.write() as db:
                return act(db)
        except _ComputationNeededError as needed:
            app.proposer.boxes.steps(needed.requests)
    raise ConflictError("expected responses to settle while a recording is withdrawn; try again")


def _withdraw(app: AppContext, db: Session, ids: Collection[int], reason: str) -> int:
    shows = or_(QueryRow.left_rollout_id.in_(ids), QueryRow.right_rollout_id.in_(ids))
    trials = select(QueryRow.trial_id).where(shows)
    sessions = select(Trial.session_id).where(Trial.id.in_(trials))
    # Before the rollouts, as responses do: neither waits for the other in turn.
    db.execute(
        select(SessionRow.id)
        .where(SessionRow.id.in_(sessions))
        .order_by(SessionRow.id)
        .with_for_update()
    )
    rollouts = db.scalars(
        select(Rollout)
        .where(Rollout.id.in_(ids))
        .order_by(Rollout.id)
        .with_for_update()
        .execution_options(populate_existing=True)
    ).all()
    number = outcomes.withdraw(db, rollouts, reason, app.now())
    judged = exists().where(QueryRow.trial_id == Trial.id, QueryRow.withdrawn_at.is_not(None))
    needed = [
        request
        for trial in db.scalars(
            select(Trial).where(Trial.id.in_(trials), judged).order_by(Trial.id)
        ).all()
        if (request := _derive_again(app, db, trial)) is not None
    ]
    if needed:
        raise _ComputationNeededError(needed)
    return number


def _derive_again(app: AppContext, db: Session, row: Trial) -> BoxRequest | None:
    """Derive the rows of a trial anew; what has to be computed first, if anything."""
    spec = queries.trial_spec(row.session, row.trial_index, row.seed, row.queries[0].engine_version)
    trial = box_trials.trial_of(row.session, spec)
    last = db.scalar(
        select(Acquired)
        .where(Acquired.trial_id == row.id)
        .order_by(Acquired.query_index.desc())
        .limit(1)
    )
    if trial is None or last is None:
        return None
    record = queries.read_record(db, row.id)
    barred = box_trials.read_barred(db, trial, row.id)
    sources = box_trials.sources_of_acquired(trial, record, barred)
    step, training = box_next.learnt(record, sources)
    derived_rows.replace_preferences(db, row.id, step, training)
    if not sources.answered:
        db.execute(delete(Acquired).where(Acquired.trial_id == row.id))
        return None
    if not barred.withdrawn & {*Sources.from_json(last.computed_from or {}).answered}:
        return None
    points = box_trials.read_points(db, trial, box_trials.candidates_of(record, barred))
    request = box_trials.request(trial, record, sources, points, proposes=False, acquires=True)
    found = app.proposer.boxes.cached(request)
    if found is None:
        return request
    assert found.acquired is not None
    [candidate] = candidate_rows.find_or_add(db, trial, [found.acquired.point]).values()
    last.candidate = candidate.candidate_index
    last.posterior_mean, last.posterior_std = found.acquired.mean, found.acquired.std
    last.sureness = found.acquired.sureness
    last.computed_from = sources.as_json()
    return None
