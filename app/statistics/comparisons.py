"""Tests between two samples: the paper's two-sample t-test, and how large the difference is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

#: Levels of the paper's stars (Fig. 11, 13 and 17), strictest first.
STARS: Final = ((0.01, "**"), (0.05, "*"))
SIGNIFICANCE: Final = 0.05
#: Two samples that never vary are told apart by their difference alone: rounding up to this, in
#: grams, is none.
ROUNDING: Final = 1e-9


class SampleError(ValueError):
    """Too few values to compare."""


@dataclass(frozen=True)
class Comparison:
    """Values of a first method against those of a second.

    difference: of the means, first minus second; low, high: its 95 % interval (Welch). t, p: of
    Student's two-sample t-test, both sides, equal variances, as in the paper. welch_t,
    welch_freedom, welch_p: of Welch's t-test, which agrees with the interval: welch_p is below .05
    exactly where the interval leaves 0 out. effect: Hedges' g.
    """

    difference: float
    low: float
    high: float
    t: float
    p: float
    welch_t: float
    welch_freedom: float
    welch_p: float
    effect: float

    @property
    def significant(self) -> bool:
        """At the 5 % level, uncorrected for how many tests there are, as in the paper."""
        return self.p < SIGNIFICANCE

    @property
    def stars(self) -> str:
        """One below .05, two below .01."""
        return stars_of(self.p)


def stars_of(p: float) -> str:
    """The stars of a p-value: one below .05, two below .01."""
    return next((stars for level, stars in STARS if p < level), "")


def compare(first: Sequence[float], second: Sequence[float]) -> Comparison:
    """The first sample against the second."""
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if min(len(a), len(b)) < 2:
        raise SampleError(f"expected two values or more on each side, got {len(a)} and {len(b)}")
    difference = float(a.mean() - b.mean())
    freedom = len(a) + len(b) - 2
    squares = float(((a - a.mean()) ** 2).sum() + ((b - b.mean()) ** 2).sum())
    pooled = float(np.sqrt(squares / freedom))
    if pooled <= ROUNDING:
        same = abs(difference) <= ROUNDING
        infinite = 0.0 if same else float(np.copysign(np.inf, difference))
        p = 1.0 if same else 0.0
        return Comparison(
            difference,
            difference,
            difference,
            infinite,
            p,
            infinite,
            float(freedom),
            p,
            infinite,
        )
    t = difference / (pooled * np.sqrt(1.0 / len(a) + 1.0 / len(b)))
    error, welch_freedom = _welch(a, b)
    half = float(special.stdtrit(welch_freedom, 0.975)) * error
    welch_t = difference / error
    small_sample = 1.0 - 3.0 / (4.0 * freedom - 1.0)
    return Comparison(
        difference,
        difference - half,
        difference + half,
        float(t),
        float(2.0 * special.stdtr(freedom, -abs(t))),
        welch_t,
        welch_freedom,
        float(2.0 * special.stdtr(welch_freedom, -abs(welch_t))),
        small_sample * difference / pooled,
    )


def _welch(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[float, float]:
    """The standard error of the difference of two means of unequal variances, and its freedom."""
    # Not scipy.stats: it warns where one sample never varies, as that of a method that always
    # finds the optimum, and takes half a second to load.
    shares = np.array([a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)])
    error = float(shares.sum())
    freedom = error**2 / float((shares**2 / np.array([len(a) - 1, len(b) - 1])).sum())
    return float(np.sqrt(error)), freedom


def p_value(p: float) -> str:
    """A p-value as it is printed: "= .012", "< .0001"."""
    if p < 0.0001:
        return "< .0001"
    digits = 3 if p >= 0.001 else 4
    return "= " + f"{p:.{digits}f}".removeprefix("0")


def interquartile_range(values: Sequence[float]) -> float:
    """The width of the middle half."""
    low, high = np.quantile(np.asarray(values, dtype=np.float64), (0.25, 0.75))
    return float(high - low)
