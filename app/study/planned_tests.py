"""The tests that the results of a plan consist of: looks at a trial, comparisons, and levels."""

from itertools import combinations
from typing import Final

from .plan import Plan

#: Numbers of answers at which the paper evaluates the acquired candidates (Fig. 17), besides the
#: end of each trial.
AFTER_ANSWERS: Final = (10, 20, 30)


def looks(plan: Plan) -> list[int]:
    """The numbers of learned answers at which trials are looked at; the last is their end."""
    most = plan.learned_per_trial
    return sorted({*(number for number in AFTER_ANSWERS if number < most), most})


def comparisons(plan: Plan) -> list[tuple[str, str]]:
    """Every two conditions of one environment, in the order of the plan."""
    return [
        (first.name, second.name)
        for first, second in combinations(plan.conditions, 2)
        if first.environment == second.environment
    ]


def is_primary(plan: Plan, first: str, second: str, after: int) -> bool:
    """Whether a comparison after so many answers is the one that the plan names as primary."""
    primary = plan.analysis.primary
    return primary is not None and {first, second} == set(primary) and after == looks(plan)[-1]


def strictest_level(plan: Plan, first: str, second: str) -> float:
    """The level of a comparison's test at the end of trials, at a family-wise level of 5 %.

    5 % for the primary comparison. Otherwise 5 % over the number of tests that Holm's method
    corrects: the strictest of its levels.
    """
    if is_primary(plan, first, second, looks(plan)[-1]):
        return 0.05
    tests = len(looks(plan)) * len(comparisons(plan)) - (plan.analysis.primary is not None)
    return 0.05 / max(tests, 1)
