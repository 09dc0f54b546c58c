"""What people like best: the candidate that their models agree on, and how sure that is.

A trial says how much each candidate is liked by its model's posterior mean, scaled from 0 (least)
to 1 (most); a trial without a model by its acquired candidate alone. A person's liking is the mean
over their finished trials, and everybody counts the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.export.table import Request, trials_of
from app.services.proposals.trial_schedule import training_history
from app.services.sessions import queries
from app.storage.models.studies import Acquired, Participant, SessionRow, Trial
from app.study.stopping import USUAL_WITHIN

#: Being better by less than this share of the range of liking makes no difference.
WITHIN: Final = USUAL_WITHIN
#: Samples of the people, drawn with replacement: a share of one half has an error of 1.6 %.
RESAMPLES: Final = 1000

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LikedBest:
    """The candidate that is liked best, in an environment or under one of its conditions.

    condition: None for all conditions together. best, runner_up: candidate indices. acquired:
    finished trials that ended with `best`. agree: people who like it at least as much as
    `runner_up`. sure: share of resamples of the people under which no candidate is better by more
    than a tenth of the range; None for a single person.
    """

    environment: str
    condition: str | None
    people: int
    trials: int
    best: int
    runner_up: int | None
    acquired: int
    agree: int
    sure: float | None


@dataclass(frozen=True)
class _Trial:
    """What one finished trial says. liking: (n,), from 0 to 1."""

    person: str
    condition: str
    acquired: int
    liking: FloatArray


def liked_best(app: AppContext, request: Request) -> list[LikedBest]:
    """For each environment what is liked best in all, then under each of its conditions.

    Fits the model of every finished trial that is not cached: some milliseconds each. Empty for a
    study over ranges, whose trials share no list of candidates.
    """
    plan = request.study.plan
    if plan.has_ranges:
        return []
    with app.database.read() as db:
        trials = _trials(app, db, request)
    found: list[LikedBest] = []
    for environment in plan.used_environments:
        named = [one.name for one in plan.conditions if one.environment == environment]
        there = [trial for trial in trials.get(environment, []) if trial.condition in named]
        present = [name for name in named if any(trial.condition == name for trial in there)]
        if len(present) > 1:
            found.append(summarise(environment, None, there))
        found += [
            summarise(environment, name, [trial for trial in there if trial.condition == name])
            for name in present
        ]
    return found


def summarise(environment: str, condition: str | None, trials: Sequence[_Trial]) -> LikedBest:
    """Summarise at least one finished trial of the same candidates."""
    people = sorted({trial.person for trial in trials})
    liking = np.array(
        [
            np.mean([trial.liking for trial in trials if trial.person == person], axis=0)
            for person in people
        ]
    )  # (people, n)
    order = np.argsort(-liking.mean(axis=0), kind="stable")
    best, runner_up = int(order[0]), int(order[1]) if len(order) > 1 else None
    agree = (
        len(people) if runner_up is None else int(np.sum(liking[:, best] >= liking[:, runner_up]))
    )
    return LikedBest(
        environment=environment,
        condition=condition,
        people=len(people),
        trials=len(trials),
        best=best,
        runner_up=runner_up,
        acquired=sum(trial.acquired == best for trial in trials),
        agree=agree,
        sure=_sure(liking, best) if len(people) > 1 else None,
    )


def _sure(liking: FloatArray, best: int) -> float:
    """The share of resamples of people under which nothing is better than `best` by `WITHIN`.

    liking: (people, n).
    """
    people = len(liking)
    draws = np.random.default_rng(0).multinomial(people, np.full(people, 1 / people), RESAMPLES)
    means = draws @ liking / people  # (resamples, n)
    highest, lowest = means.max(axis=1), means.min(axis=1)
    return float(np.mean(highest - means[:, best] <= WITHIN * (highest - lowest)))


def _trials(app: AppContext, db: Session, request: Request) -> dict[str, list[_Trial]]:
    statement = (
        select(Trial, Participant.pseudonym)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .where(Trial.trial_index >= 0, Trial.ended_at.is_not(None), *trials_of(request))
        .order_by(SessionRow.id, Trial.trial_index)
    )
    found: dict[str, list[_Trial]] = {}
    for trial, person in db.execute(statement).all():
        acquired = db.scalar(
            select(Acquired.candidate)
            .where(Acquired.trial_id == trial.id)
            .order_by(Acquired.query_index.desc())
            .limit(1)
        )
        if acquired is not None:
            said = _Trial(person, trial.condition, acquired, _liking(app, db, trial, acquired))
            found.setdefault(trial.environment, []).append(said)
    return found


def _liking(app: AppContext, db: Session, trial: Trial, acquired: int) -> FloatArray:
    """How much a trial likes each candidate, (n,), from 0 to 1."""
    space = app.proposer.candidate_set(trial.session.study_id, trial.environment)
    mean = _posterior_mean(app, db, trial, space)
    if mean is None or np.ptp(mean) == 0:
        votes = np.zeros(len(space.candidates))
        votes[acquired] = 1.0
        return votes
    scaled: FloatArray = (mean - mean.min()) / np.ptp(mean)
    return scaled


def _posterior_mean(app: AppContext, db: Session, trial: Trial, space: Any) -> FloatArray | None:
    spec = queries.trial_spec(
        trial.session, trial.trial_index, trial.seed, trial.queries[0].engine_version
    )
    history = training_history(spec, queries.read_record(db, trial.id))
    belief = app.proposer.posteriors.posterior(
        space.candidates, spec.method, spec.settings, spec.seed, history
    )
    return None if belief is None else belief[0]
