"""Trials over a search space given by ranges: what their steps are computed from.

A step depends on the answered queries that are learnt from, the pairs that wait for a response, and
the candidates that are not proposed. Which these were is stored with every query and every acquired
candidate, so that each can be computed again from its row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from app.pbbo import SKIP_REASONS
from app.services.proposals.box_steps import BoxRequest, Point, PointAnswer
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.trial_schedule import (
    AnsweredQueries,
    AskedQuery,
    is_training,
)
from app.services.rollouts import lookup as rollouts
from app.services.rollouts import states
from app.services.studies.repository import stored_plan
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, QueryRow, SessionRow
from app.study.environments import RolloutSettings
from app.study.search_space import SearchSpace


@dataclass(frozen=True)
class BoxTrial:
    """The constants of a trial over a search space."""

    spec: TrialSpec
    space: SearchSpace
    rollout: RolloutSettings


@dataclass(frozen=True)
class Sources:
    """What a step is computed from, besides the space, the settings and the seed.

    answered: indices of the queries that are learnt from. pending: pairs of candidates that wait
    for a response. excluded: unsafe candidates. failed: candidates that no machine could record for
    this trial.
    """

    answered: tuple[int, ...] = ()
    pending: tuple[tuple[int, int], ...] = ()
    excluded: tuple[int, ...] = ()
    failed: tuple[int, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """As it is stored; candidates by index."""
        return {
            "answered": list(self.answered),
            "pending": [list(pair) for pair in self.pending],
            "excluded": list(self.excluded),
            "failed": list(self.failed),
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """As it was stored."""
        return cls(
            tuple(stored["answered"]),
            tuple((left, right) for left, right in stored["pending"]),
            tuple(stored["excluded"]),
            tuple(stored["failed"]),
        )


@dataclass(frozen=True)
class Barred:
    """What is not learnt from, and not proposed, at one moment.

    withdrawn: indices of the trial's queries whose recordings were withdrawn. excluded, failed: as
    in `Sources`, in order.
    """

    withdrawn: frozenset[int] = frozenset()
    excluded: tuple[int, ...] = ()
    failed: tuple[int, ...] = ()


def trial_of(session: SessionRow, spec: TrialSpec) -> BoxTrial | None:
    """The trial of this specification; None if the study has a list of candidates."""
    plan = stored_plan(session.plan)
    if not plan.has_ranges:
        return None
    assert plan.space is not None
    return BoxTrial(spec, plan.space, plan.environments[spec.environment].rollout)


def read_barred(db: Session, trial: BoxTrial, trial_id: int | None) -> Barred:
    """What is not learnt from and not proposed now. trial_id: None before the trial has begun."""
    excluded = rollouts.unsafe_candidates(db, trial.spec.study_id, trial.spec.environment)
    if trial_id is None:
        return Barred(excluded=tuple(sorted(excluded)))
    withdrawn = db.scalars(
        select(QueryRow.query_index).where(
            QueryRow.trial_id == trial_id,
            QueryRow.withdrawn_at.is_not(None),
            QueryRow.set_aside_at.is_(None),
        )
    )
    lost = db.scalars(
        select(Candidate.candidate_index)
        .join(Rollout, Rollout.candidate_id == Candidate.id)
        .join(
            QueryRow,
            or_(QueryRow.left_rollout_id == Rollout.id, QueryRow.right_rollout_id == Rollout.id),
        )
        .where(
            QueryRow.trial_id == trial_id,
            Rollout.status.in_((states.FAILED, states.CANCELLED)),
        )
    )
    failed_ahead = db.scalars(
        select(Candidate.candidate_index)
        .join(Rollout, Rollout.candidate_id == Candidate.id)
        .where(Rollout.trial_id == trial_id, Rollout.status == states.FAILED)
    )
    failed = {*lost, *failed_ahead} - excluded
    return Barred(frozenset(withdrawn), tuple(sorted(excluded)), tuple(sorted(failed)))


def sources_of_query(
    trial: BoxTrial, record: AnsweredQueries, place: int, barred: Barred
) -> Sources:
    """What the query at index `place` is proposed from.

    With `lag: 1` the response just before it is not used, so that its recording can be asked for
    while the pair before it plays. record: the answered queries before it.
    """
    first_unused = place - trial.rollout.lag
    learnt = _learnt(trial, record, barred)
    return Sources(
        answered=tuple(one.query_index for one in learnt if one.query_index < first_unused),
        pending=tuple((one.left, one.right) for one in learnt if one.query_index >= first_unused),
        excluded=barred.excluded,
        failed=barred.failed,
    )


def sources_of_acquired(trial: BoxTrial, record: AnsweredQueries, barred: Barred) -> Sources:
    """What the candidate acquired after these answered queries is computed from."""
    answered = tuple(one.query_index for one in _learnt(trial, record, barred))
    return Sources(answered=answered, excluded=barred.excluded, failed=barred.failed)


def request(
    trial: BoxTrial,
    record: AnsweredQueries,
    sources: Sources,
    points: Mapping[int, Point],
    *,
    proposes: bool,
    acquires: bool,
) -> BoxRequest:
    """The request of a step. points: by candidate index, at least those that the step needs."""
    by_place = {one.query_index: one for one in record}
    return BoxRequest(
        space=trial.space,
        settings=trial.spec.settings,
        seed=trial.spec.seed,
        new=trial.rollout.new_per_query,
        history=tuple(_answer(by_place[place], points) for place in sources.answered),
        pending=tuple((points[left], points[right]) for left, right in sources.pending),
        excluded=tuple(points[index] for index in sources.excluded),
        unavailable=tuple(points[index] for index in sources.failed),
        proposes=proposes,
        acquires=acquires,
        within=trial.spec.within if acquires else None,
    )


def candidates_of(
    record: Iterable[AskedQuery], barred: Barred = Barred(), *sources: Sources
) -> set[int]:
    """Indices of the candidates whose points the steps of a trial need."""
    found = {index for one in record for index in (one.left, one.right)}
    found.update(barred.excluded, barred.failed)
    for one in sources:
        found.update(one.excluded, one.failed, *one.pending)
    return found


def read_points(db: Session, trial: BoxTrial, indices: Iterable[int]) -> dict[int, Point]:
    """The points of these candidates, by index."""
    rows = db.execute(
        select(Candidate.candidate_index, Candidate.parameters).where(
            Candidate.study_id == trial.spec.study_id,
            Candidate.environment == trial.spec.environment,
            Candidate.candidate_index.in_(sorted(set(indices))),
        )
    )
    names = trial.space.names
    return {index: tuple(float(values[name]) for name in names) for index, values in rows}


def _learnt(trial: BoxTrial, record: AnsweredQueries, barred: Barred) -> list[AskedQuery]:
    return [
        one
        for one in record
        if is_training(trial.spec, one.trial_type) and one.query_index not in barred.withdrawn
    ]


def _answer(shown: AskedQuery, points: Mapping[int, Point]) -> PointAnswer:
    pair = (points[shown.left], points[shown.right])
    if shown.skip_reason in SKIP_REASONS:
        return (*pair, shown.response or "", shown.skip_reason)
    return (*pair, shown.response or "")
