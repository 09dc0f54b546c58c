"""The tables of people and of the population: all answers under a condition, judged together."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy.orm import Session

from app.services.pooling.people import PooledPeople, judged_together
from app.study.plan import Plan

from .cells import Value
from .table import (
    PARTICIPANT,
    STUDY,
    Column,
    Request,
    Row,
    Table,
    boolean,
    integer,
    number,
    parameters,
    text,
    trials_of,
)
from .trials import CONDITION


def _people_columns(plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        CONDITION,
        text("environment", "Environment of the candidates."),
        PARTICIPANT,
        integer("responses", "Responses that the model learned from."),
        integer("skips", "How many of them were skips."),
        number("noise", "Noise of their choices, as a multiple of the average one."),
        number("noise_low", "Lower end of its 90 % interval."),
        number("noise_high", "Upper end of its 90 % interval."),
        number("noise_probability", "Probability that the noise is 2.5 times the average or more."),
        number("threshold", "Threshold of acceptability, in units of the posterior; none without"
               " skips."),
        integer("accepted", "How many candidates lie above the threshold."),
        number("share", "Share of the variance of their values that is a taste of their own."),
        number("likeness", "Correlation of their values with the population's."),
        integer("candidate", "Index of their own best candidate; none where it was never shown."),
        *parameters(plan, "", "their own best candidate"),
        number("costs", "By how much the population's best lies below their own best, in their own"
               " values, as a share of the range of these."),
        boolean("differs", "Whether costs are a quarter or more, and not by noise alone. It says"
                " nothing of reliability."),
        text("nearest", "Participant whose values are most like theirs."),
        integer("kind", "Number of their kind of taste, the largest 1; empty if kinds cannot be"
                " told apart."),
        number("influence", "Root mean square change of the population's values without them, in"
               " standard deviations of these values."),
        integer("best_without", "Index of the population's best candidate without them."),
        number("moves", "By how much that lies below the population's best, as a share of the"
               " range."),
        boolean("flagged", "Whether there is a reason against relying on their answers."),
        text("reasons", "The reasons, in words."),
    )  # fmt: skip


def _people_rows(db: Session, request: Request) -> Iterator[Row]:
    for found in _judged(db, request):
        assert found.summary is not None
        for person in found.people:
            one = person.summary
            nearest = None if one.nearest is None else found.people[one.nearest].name
            yield (
                request.study.slug,
                found.condition,
                found.pooled.environment,
                one.name,
                one.answers,
                one.skips,
                _rounded(one.noise.value),
                _rounded(one.noise.low),
                _rounded(one.noise.high),
                _rounded(one.noisy),
                _rounded(one.threshold),
                one.accepted,
                _rounded(one.own_share),
                _rounded(one.likeness),
                found.candidate(one.best),
                *_point(found, one.best),
                _rounded(one.costs),
                person.differs,
                nearest,
                None if one.kind is None else one.kind + 1,
                _rounded(one.influence),
                found.candidate(one.best_without),
                _rounded(one.moves),
                bool(person.reasons),
                " ".join(person.reasons),
            )


def _population_columns(plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        CONDITION,
        text("environment", "Environment of the candidates."),
        integer("candidate", "Index of the candidate; none for a point that was never shown."),
        *parameters(plan, "", "the candidate"),
        number("posterior_mean", "Posterior mean of the population's value."),
        number("posterior_std", "Posterior standard deviation of the same."),
        number("disagreement", "Standard deviation of people's own values about the population's."),
        number("best_probability", "Probability that it is the population's best candidate."),
        boolean("is_best", "Whether its posterior mean is the largest."),
        integer("times_shown", "How often it was shown in answered pairs."),
    )


def _population_rows(db: Session, request: Request) -> Iterator[Row]:
    for found in _judged(db, request):
        summary = found.summary
        assert summary is not None
        shown = found.pooled.shown
        for row in range(len(summary.points)):
            yield (
                request.study.slug,
                found.condition,
                found.pooled.environment,
                found.candidate(row),
                *_point(found, row),
                _rounded(summary.mean[row]),
                _rounded(summary.std[row]),
                _rounded(summary.disagreement[row]),
                _rounded(summary.best_probability[row]),
                row == summary.best,
                shown[row] if row < len(shown) else 0,
            )


def _judged(db: Session, request: Request) -> Iterator[PooledPeople]:
    """The conditions of the request that two people or more have answered under."""
    plan = request.study.plan
    for condition in plan.conditions:
        if request.conditions and condition.name not in request.conditions:
            continue
        found = judged_together(
            db, request.people, request.study, condition.name, request.modes, *trials_of(request)
        )
        if found.summary is not None:
            yield found


def _point(found: PooledPeople, row: int) -> tuple[Value, ...]:
    assert found.summary is not None
    return tuple(float(value) for value in found.summary.points[row])


def _rounded(value: float | None) -> float | None:
    """Six digits: what is beyond depends on the machine."""
    return None if value is None else float(f"{value:.6g}")


PEOPLE = Table(
    "people",
    "Each person's taste and reliability, from all answers under a condition judged together.",
    _people_columns,
    _people_rows,
)
POPULATION = Table(
    "population",
    "What people like together: the posterior over the candidates from everybody's answers.",
    _population_columns,
    _population_rows,
)
