"""Checks among the queries of a trial: their settings, and their places.

A repeat shows an earlier query again with its sides swapped; an attention check shows a recording
known to be bad against one known to be good. Both measure the reliability of the responses.
"""

import math
from collections.abc import Iterator, Mapping
from enum import StrEnum
from typing import Annotated

import numpy as np
from pydantic import Field, StrictBool, StrictStr

from .parsed_plan import Inconsistency, Place, as_list, as_mapping
from .plan_model import Finite, Part

#: Checks are at most half of the pairs shown.
LARGEST_SHARE = 0.5

Share = Annotated[float, Field(strict=True, ge=0, le=LARGEST_SHARE, allow_inf_nan=False)]
CandidatePoint = dict[StrictStr, Finite]

_SHARE = f"a share of queries_per_trial from 0 (none) to {LARGEST_SHARE}"
_POINTS = "a list of candidates such as [{speed: 0.5, height: 0.2}]"


class Checks(Part):
    """Repeats and attention checks, in addition to the queries of a trial."""

    repeats: Share = Field(default=0.0, description=_SHARE)
    attention: Share = Field(default=0.0, description=_SHARE)
    good: tuple[CandidatePoint, ...] = Field(default=(), max_length=100, description=_POINTS)
    bad: tuple[CandidatePoint, ...] = Field(default=(), max_length=100, description=_POINTS)
    in_model: StrictBool = Field(
        default=False, description="true or false: whether the model learns from checks"
    )


class Kind(StrEnum):
    """What is shown at one place of a trial."""

    MODEL = "model"
    REPEAT = "repeat"
    ATTENTION = "attention"


def number(share: float, queries: int) -> int:
    """The number of checks for a share of the queries, rounded to the nearest integer."""
    return math.floor(share * queries + 0.5)


def schedule(
    queries: int, repeats: int, attention: int, rng: np.random.Generator
) -> tuple[Kind, ...]:
    """The sequence of a trial: its queries, and checks at random places between them.

    At most one check follows a query. A repeat is placed only where at least one query other than
    the last has not been repeated yet.
    """
    if repeats > max(0, queries - 1) or repeats + attention > queries:
        raise ValueError(f"expected room after {queries} queries, got {repeats} + {attention}")
    later = rng.permutation(np.arange(2, queries + 1))[:repeats]
    free = [after for after in range(1, queries + 1) if after not in later]
    anywhere = rng.permutation(np.array(free, dtype=int))[:attention]
    check_after = dict.fromkeys(map(int, later), Kind.REPEAT)
    check_after |= dict.fromkeys(map(int, anywhere), Kind.ATTENTION)
    places: list[Kind] = []
    for asked in range(1, queries + 1):
        places.append(Kind.MODEL)
        if asked in check_after:
            places.append(check_after[asked])
    return tuple(places)


def checks_inconsistencies(
    plan: Mapping[str, object], parameters: list[object]
) -> Iterator[Inconsistency]:
    """Checks that do not fit into a trial, and candidates that do not exist."""
    checks = as_mapping(plan.get("checks"))
    queries = plan.get("queries_per_trial")
    if isinstance(queries, int) and not isinstance(queries, bool) and queries >= 1:
        yield from _room(checks, queries)
    for name, other in (("good", "bad"), ("bad", "good")):
        points = as_list(checks.get(name))
        if points and not as_list(checks.get(other)):
            message = f"expected candidates in {other} as well, got none"
            yield Inconsistency(("checks", name), message)
        for index, point in enumerate(points):
            place: Place = ("checks", name, index)
            given = as_mapping(point)
            if given and set(given) != set(map(str, parameters)):
                wanted, came = ", ".join(map(str, parameters)), ", ".join(given)
                yield Inconsistency(place, f"expected the parameters {wanted}, got {came}")
            if name == "bad" and point in as_list(checks.get("good")):
                yield Inconsistency(place, "expected a candidate that is not in good as well")


def _room(checks: Mapping[str, object], queries: int) -> Iterator[Inconsistency]:
    numbers: dict[str, int] = {}
    for name in ("repeats", "attention"):
        share = checks.get(name, 0.0)
        if not isinstance(share, int | float) or not 0 <= share <= LARGEST_SHARE:
            return
        numbers[name] = number(share, queries)
        if share > 0 and numbers[name] == 0:
            message = f"expected a share that makes one of {queries} queries at least, got {share}"
            yield Inconsistency(("checks", name), message)
    if numbers["repeats"] > max(0, queries - 1):
        message = f"expected more than one query to repeat one of, got {queries}"
        yield Inconsistency(("checks", "repeats"), message)
    elif sum(numbers.values()) > queries:
        message = f"expected one check after each of {queries} queries at most, got more"
        yield Inconsistency(("checks", "attention"), message)
