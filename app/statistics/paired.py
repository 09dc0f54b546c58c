"""The paired t-test of two conditions that the same people were measured under."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from .comparisons import ROUNDING, SampleError


@dataclass(frozen=True)
class PairedComparison:
    """A first condition against a second, within `people` people.

    difference: mean of the differences, first minus second; low, high: its 95 % interval (Student).
    t, freedom, p: of the two-sided paired t-test. effect: the mean of the differences over their
    standard deviation (Cohen's d_z).
    """

    people: int
    difference: float
    low: float
    high: float
    t: float
    freedom: int
    p: float
    effect: float


def compare_paired(first: Sequence[float], second: Sequence[float]) -> PairedComparison:
    """Compare two conditions by the paired t-test.

    first, second: one value of each person, shape (people,), in the same order of people. Raises
    SampleError for fewer than two people.
    """
    if len(first) != len(second):
        raise ValueError(
            f"expected a value of every person on both sides, got {len(first)} and {len(second)}"
        )
    people = len(first)
    if people < 2:
        raise SampleError(f"expected two people or more, got {people}")
    differences = np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64)
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    freedom = people - 1
    if spread <= ROUNDING:
        same = abs(mean) <= ROUNDING
        infinite = 0.0 if same else float(np.copysign(np.inf, mean))
        p = 1.0 if same else 0.0
        return PairedComparison(people, mean, mean, mean, infinite, freedom, p, infinite)
    error = spread / float(np.sqrt(people))
    t = mean / error
    half = float(special.stdtrit(freedom, 0.975)) * error
    p = float(2.0 * special.stdtr(freedom, -abs(t)))
    return PairedComparison(people, mean, mean - half, mean + half, t, freedom, p, mean / spread)


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Holm's (1979) adjusted p-values of a family of tests, shape (m,), in the given order.

    The k-th smallest is multiplied by m - k + 1; none is smaller than the one before it, nor
    greater than 1.
    """
    order = sorted(range(len(p_values)), key=lambda place: p_values[place])
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, place in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return tuple(adjusted)
