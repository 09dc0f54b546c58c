"""The search space of a study over ranges, as the optimiser's box."""

from __future__ import annotations

from collections.abc import Iterator

from app.pbbo import Box, BoxError, ConstraintError
from app.study.parsed_plan import Inconsistency
from app.study.plan import Plan
from app.study.search_space import SearchSpace


def box_of(plan: Plan) -> Box:
    """The box of a plan whose parameters have ranges. Raises ValueError if they have none."""
    if plan.space is None:
        raise ValueError(f"expected parameters with ranges in the plan of {plan.slug!r}, got none")
    return box_in(plan.space)


def box_in(space: SearchSpace) -> Box:
    """The optimiser's box of a search space. Raises BoxError or ConstraintError."""
    return Box(
        low=space.low,
        high=space.high,
        step=space.step,
        log=space.log,
        names=space.names,
        constraints=space.constraints,
    )


def space_faults(space: SearchSpace) -> Iterator[Inconsistency]:
    """What is wrong with each constraint by itself, or else with all of them together."""
    alone = list(_faults_of_each(space))
    yield from alone
    if alone:
        return
    try:
        box_in(space)
    except ConstraintError as error:
        yield Inconsistency(("constraints",), _message(error))
    except BoxError as error:
        yield Inconsistency(("parameters",), str(error))


def _faults_of_each(space: SearchSpace) -> Iterator[Inconsistency]:
    for index, constraint in enumerate(space.constraints):
        try:
            Box(space.low, space.high, constraints=[constraint], names=space.names)
        except ConstraintError as error:
            yield Inconsistency(("constraints", index), _message(error))


def _message(error: ConstraintError) -> str:
    return str(error).removeprefix("constraints: ")
