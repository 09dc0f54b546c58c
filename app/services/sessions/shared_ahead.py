"""Computes pairs under a shared model ahead: the next while a pair plays, and the first while its
person reads what comes before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from sqlalchemy import event
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals.proposer import ProposedQuery
from app.services.proposals.trial_schedule import is_training

from . import box_ahead, shared_next, shared_trials
from .queries import OpenQuery
from .shared_next import PreparedSteps
from .shared_trials import Moment, SharedAnswer, SharedTrial


def prepare(
    app: AppContext, db: Session, trial: SharedTrial, query: OpenQuery
) -> list[ProposedQuery]:
    """Start to compute the step after each possible response to the open query.

    Returns the queries that may follow, the likeliest first; empty until all of them are computed.
    Within a writing transaction, the work starts after its commit.
    """
    place = query.asked.query_index + 1
    prepared = app.proposer.shared.prepared(trial.spec.seed, place)
    answers = _possible(trial, query)
    if isinstance(prepared, PreparedSteps):
        moment = shared_trials.read_moment(db, trial, app.now())
        steps = [
            shared_next.holding(app, trial, place, prepared, moment, shared_next.told(own))
            for own in answers
        ]
        if None not in steps:
            return [step.proposal for step in steps if step is not None and step.proposal]

    def start(_db: Session | None = None) -> None:
        key = ("ahead", trial.spec.seed, query.public_id)
        app.background.in_thread(key, _work, app, trial, query)

    _after_commit(app, db, start)
    return []


def prepare_first(app: AppContext, db: Session, trial: SharedTrial) -> None:
    """Start to compute the first step of a trial that begins later.

    Within a writing transaction, the work starts after its commit.
    """

    def start(_db: Session | None = None) -> None:
        app.background.in_thread(("ahead", trial.spec.seed), _work_first, app, trial)

    _after_commit(app, db, start)


def _after_commit(app: AppContext, db: Session, start: Callable[..., None]) -> None:
    if app.database.is_writing(db):
        event.listen(db, "after_commit", start, once=True)
    else:
        start()


def _possible(trial: SharedTrial, query: OpenQuery) -> list[SharedAnswer | None]:
    """The answers that may come, as far as they are learnt from."""
    if not is_training(trial.spec, query.asked.trial_type):
        return [None]
    return [
        shared_trials.answer_to(trial, replace(query.asked, response=response))
        for response in ("left", "right", "skip")
    ]


def _work(app: AppContext, trial: SharedTrial, query: OpenQuery) -> None:
    with app.database.read() as db:
        if not box_ahead.is_open(db, query.public_id):
            return
        moment = shared_trials.read_moment(db, trial, app.now())
    _prepare(app, trial, query.asked.query_index + 1, moment, _possible(trial, query))


def _work_first(app: AppContext, trial: SharedTrial) -> None:
    with app.database.read() as db:
        moment = shared_trials.read_moment(db, trial, app.now())
    _prepare(app, trial, 0, moment, [None])


def _prepare(
    app: AppContext,
    trial: SharedTrial,
    place: int,
    moment: Moment,
    answers: Sequence[SharedAnswer | None],
) -> None:
    """Compute and keep these steps, and render the first choice of each."""
    prepared = shared_next.prepare(app, trial, place, moment, answers, ahead=True)
    for step in prepared.steps.values():
        for choice in step.choices[:1]:
            proposal = shared_next.proposed(app, trial, choice, place)
            app.proposer.render([proposal.left, proposal.right])
