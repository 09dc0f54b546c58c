"""What follows in a trial under a shared model: the next pair, and the acquired candidate.

Steps are computed outside transactions, ahead where possible, and kept with the answers that they
were computed from. A step may be some answers behind when it is stored; it is computed again if one
of its answers no longer counts, or if all of its pairs are looked at by others by then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

from app.services.context import AppContext
from app.services.proposals.computation import AcquiredCandidate
from app.services.proposals.proposer import ProposedQuery, with_recordings
from app.services.proposals.shared_steps import Choice, Pair, SharedRequest, SharedStep
from app.services.proposals.trial_schedule import kind_at
from app.services.runtime.errors import ConflictError
from app.study.attention_checks import Kind

from . import shared_trials
from .shared_trials import Moment, SharedAnswer, SharedTrial

T = TypeVar("T")

#: A step that was computed more answers ago than this is computed again.
MOST_BEHIND: Final = 20
#: Pairs that a step proposes, each in case that others look at those before it.
CHOICES: Final = 4
#: How often a step is computed for one call, because what it was computed from has changed.
MOST_ROUNDS: Final = 8

#: A response with its reason; None where none is learnt from.
Told = tuple[str, str | None] | None


@dataclass(frozen=True)
class Step:
    """A step that holds at the moment at which it is stored.

    proposal: None where the model proposes nothing. used: the answers learnt from, without the one
    that the step follows. avoided: pairs that others were looking at.
    """

    proposal: ProposedQuery | None
    acquired: AcquiredCandidate | None
    used: tuple[SharedAnswer, ...]
    avoided: tuple[Pair, ...]


@dataclass(frozen=True)
class PreparedSteps:
    """Steps after each response that were computed at one moment; see `proposer.Prepared`.

    ahead: whether in the background, before one of them was asked for.
    """

    ahead: bool
    moment: Moment
    steps: Mapping[Told, SharedStep]

    @property
    def seeds(self) -> frozenset[int]:
        """The seeds of the trials learnt from."""
        return frozenset(answer.seed for answer in self.moment.answers)


class StepNeededError(Exception):
    """A step has to be computed, outside the transaction, before it can be stored."""

    def __init__(self, trial: SharedTrial, place: int, moment: Moment, own: SharedAnswer | None):
        super().__init__(f"expected a computed step for query {place}, there is none")
        self.trial, self.place, self.moment, self.own = trial, place, moment, own


def computing(app: AppContext, act: Callable[[], T]) -> T:
    """Call `act`, and again after each step that it turns out to need.

    act: has written nothing when it raises StepNeededError. Raises ConflictError.
    """
    for _ in range(MOST_ROUNDS):
        try:
            return act()
        except StepNeededError as needed:
            prepare(app, needed.trial, needed.place, needed.moment, [needed.own], ahead=False)
    raise ConflictError("expected the answers of others to settle; send the response again")


def prepare(
    app: AppContext,
    trial: SharedTrial,
    place: int,
    moment: Moment,
    answers: Sequence[SharedAnswer | None],
    *,
    ahead: bool,
) -> PreparedSteps:
    """Compute the step after each of these answers, and keep them for the query at this index."""
    requests = [request(app, trial, moment, own, proposes_at(trial, place)) for own in answers]
    steps = app.proposer.shared.steps(requests, starts_process=ahead)
    prepared = PreparedSteps(ahead, moment, dict(zip(map(told, answers), steps, strict=True)))
    app.proposer.shared.prepare(trial.spec.seed, place, prepared)
    return prepared


def after(
    app: AppContext, trial: SharedTrial, place: int, moment: Moment, own: SharedAnswer | None
) -> Step:
    """The step for the query at this index, if one is kept that still holds.

    own: the answer just given; None if it is not learnt from, or before the first query. Raises
    StepNeededError.
    """
    prepared = app.proposer.shared.prepared(trial.spec.seed, place)
    if isinstance(prepared, PreparedSteps):
        found = holding(app, trial, place, prepared, moment, told(own))
        if found is not None:
            app.metrics.step_asked(ahead=prepared.ahead)
            return found
    raise StepNeededError(trial, place, moment, own)


def holding(
    app: AppContext,
    trial: SharedTrial,
    place: int,
    prepared: PreparedSteps,
    moment: Moment,
    response: Told,
) -> Step | None:
    """The step after this response, if it holds at the moment."""
    base, step = prepared.moment, prepared.steps.get(response)
    behind = len(moment.answers) - len(base.answers)
    if step is None or behind > MOST_BEHIND or not set(moment.answers).issuperset(base.answers):
        return None
    if not proposes_at(trial, place):
        return Step(None, step.acquired, base.answers, base.open)
    avoided = list(base.open)
    for choice in step.choices:
        pair = pair_of(choice)
        if pair not in moment.open:
            proposal = proposed(app, trial, choice, place)
            return Step(proposal, step.acquired, base.answers, tuple(avoided))
        avoided.append(pair)
    return None


def request(
    app: AppContext,
    trial: SharedTrial,
    moment: Moment,
    own: SharedAnswer | None,
    proposes: bool,
) -> SharedRequest:
    """The request of the step after these answers and the one just given."""
    answers = moment.answers if own is None else (*moment.answers, own)
    return request_from(app, trial, answers, moment.open, CHOICES if proposes else 0)


def request_from(
    app: AppContext,
    trial: SharedTrial,
    answers: Sequence[SharedAnswer],
    avoided: tuple[Pair, ...],
    choices: int,
    *,
    acquires: bool = True,
) -> SharedRequest:
    """The request of a step by exactly these answers."""
    history, names = shared_trials.history(trial, answers)
    space = app.proposer.candidate_set(trial.study_id, trial.spec.environment)
    return SharedRequest(
        candidates=space.candidates,
        settings=trial.spec.settings,
        seed=trial.seed,
        history=history,
        person=names.get(trial.person, str(len(names))),
        avoided=avoided,
        target=trial.target,
        choices=choices,
        acquires=acquires,
        within=trial.spec.within,
    )


def proposed(app: AppContext, trial: SharedTrial, choice: Choice, place: int) -> ProposedQuery:
    """A choice as the query at this index of the trial, with recordings drawn for it."""
    space = app.proposer.candidate_set(trial.study_id, trial.spec.environment)
    spec = replace(trial.spec, seed=trial.seed)
    query = with_recordings(space, spec, choice.query, choice.likelier)
    return replace(query, query_index=place)


def proposes_at(trial: SharedTrial, place: int) -> bool:
    """Whether the model proposes the query at this index: it is no check, nor past the end."""
    return kind_at(trial.spec, place) is Kind.MODEL


def pair_of(choice: Choice) -> Pair:
    """The candidates of a choice, the smaller first."""
    query = choice.query
    return min(query.left, query.right), max(query.left, query.right)


def told(own: SharedAnswer | None) -> Told:
    """What a step is kept by."""
    return None if own is None else (own.response, own.reason)
