"""How sure a mean is, and how many people a comparison needs: Student's t, paired."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

#: More people than any study of this kind finds.
MOST_PEOPLE = 2000


@dataclass(frozen=True)
class Interval:
    """A mean with its 95 % interval; without one where there are fewer than two values."""

    mean: float
    low: float | None
    high: float | None
    n: int


def mean_interval(values: Sequence[float]) -> Interval:
    """Mean of values of shape (n,), n >= 1, with Student's interval. Raises ValueError if empty."""
    if not values:
        raise ValueError("expected at least one value, got none")
    mean, n = float(np.mean(values)), len(values)
    if n < 2:
        return Interval(mean, None, None, n)
    half = float(special.stdtrit(n - 1, 0.975)) * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Interval(mean, mean - half, mean + half, n)


def paired_power(effect: float, n: int, alpha: float = 0.05) -> float:
    """Power of the two-sided paired t test.

    effect: mean of the differences over their standard deviation. Noncentral t with n - 1 degrees
    of freedom and noncentrality effect * sqrt(n) (Cohen 1988, section 2.5).
    """
    critical = float(special.stdtrit(n - 1, 1 - alpha / 2))
    shift = effect * math.sqrt(n)
    # Where almost nothing lies below, the function gives up instead of giving 0.
    below, far_below = np.nan_to_num(special.nctdtr(n - 1, shift, np.array([critical, -critical])))
    return float(1 - below + far_below)


@dataclass(frozen=True)
class PeopleNeeded:
    """How many people a comparison needs: at the observed effect, and at the ends of its interval.

    likely: at the observed effect. fewest, most: at the largest and the smallest effect of the
    80 % interval. None: more than 2000, or no number where the interval holds no difference.
    """

    likely: int | None
    fewest: int | None
    most: int | None


def people_needed(
    differences: Sequence[float], power: float = 0.8, alpha: float = 0.05
) -> PeopleNeeded | None:
    """The number of people with which a paired t-test has this power, as a range.

    differences: of people, shape (n,). alpha: level of the two-sided test. None where there are
    fewer than two differences, or where they are all 0.
    """
    if len(differences) < 2:
        return None
    n = len(differences)
    spread, mean = float(np.std(differences, ddof=1)), float(np.mean(differences))
    if spread <= 1e-12 * abs(mean):
        return None if mean == 0 else PeopleNeeded(2, 2, 2)
    effect = abs(mean) / spread
    low, high = effect_interval(effect, n)
    return PeopleNeeded(
        _people(effect, power, alpha), _people(high, power, alpha), _people(low, power, alpha)
    )


def effect_interval(effect: float, n: int, level: float = 0.8) -> tuple[float, float]:
    """The interval of a standardised mean difference of n people (Steiger and Fouladi 1997).

    The ends are the effects under which the observed t = effect * sqrt(n) is the upper and the
    lower quantile of the noncentral t distribution.
    """
    t, tail = effect * math.sqrt(n), (1 - level) / 2
    low, high = special.nctdtrinc(n - 1, np.array([1 - tail, tail]), t)
    return float(low) / math.sqrt(n), float(high) / math.sqrt(n)


def _people(effect: float, power: float, alpha: float) -> int | None:
    """The fewest people for this power; None for an effect of 0 or less, or beyond 2000."""
    if effect <= 0 or paired_power(effect, MOST_PEOPLE, alpha) < power:
        return None
    low, high = 2, MOST_PEOPLE
    while low < high:
        middle = (low + high) // 2
        if paired_power(effect, middle, alpha) >= power:
            high = middle
        else:
            low = middle + 1
    return low
