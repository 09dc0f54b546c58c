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


def people_needed(differences: Sequence[float], power: float = 0.8) -> int | None:
    """The fewest people for this power, if the differences are as those given, of shape (n,).

    None where there are fewer than two, where they do not differ, or where it takes more than
    2000.
    """
    if len(differences) < 2:
        return None
    spread, mean = float(np.std(differences, ddof=1)), float(np.mean(differences))
    if mean == 0:
        return None
    if spread < 1e-12 * abs(mean):
        return 2
    effect = abs(mean) / spread
    if paired_power(effect, MOST_PEOPLE) < power:
        return None
    low, high = 2, MOST_PEOPLE
    while low < high:
        middle = (low + high) // 2
        if paired_power(effect, middle) >= power:
            high = middle
        else:
            low = middle + 1
    return low
