"""Whether an environment has the candidates or scores that a plan's attention checks need."""

import math
from collections.abc import Iterator, Sequence

from .parsed_plan import Inconsistency
from .plan import Plan


def missing_for_checks(
    plan: Plan,
    environment: str,
    candidates: Sequence[Sequence[float | str]],
    scored: Sequence[Sequence[float | str]] | None,
) -> Iterator[Inconsistency]:
    """What this environment lacks for the checks.

    candidates: its points. scored: the point of each recording with a score; None if all have one.
    """
    names = [parameter.name for parameter in plan.parameters]
    for end, points in (("good", plan.checks.good), ("bad", plan.checks.bad)):
        for index, point in enumerate(points):
            wanted = [point[name] for name in names]
            if not any(_same(wanted, candidate) for candidate in candidates):
                came = ", ".join(f"{name} {value}" for name, value in point.items())
                message = f"expected a candidate of environment {environment}, got {came}"
                yield Inconsistency(("checks", end, index), message)
    by_score = plan.attention_per_trial > 0 and not plan.checks.good
    if by_score and scored is not None and len(set(map(tuple, scored))) < 2:
        message = (
            f"expected candidates in good and bad, or scores of at least two candidates of"
            f" environment {environment}, got {len(scored)} recordings with a score"
        )
        yield Inconsistency(("checks", "attention"), message)


def _same(one: Sequence[float | str], other: Sequence[float | str]) -> bool:
    return all(
        a == b if isinstance(a, str) or isinstance(b, str) else math.isclose(a, b)
        for a, b in zip(one, other, strict=True)
    )
