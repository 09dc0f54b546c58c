"""A share of so many, with its interval: how often left was chosen, or a check passed."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Final

#: Of a normal distribution, this many deviations either way hold 95 %.
DEVIATIONS_95: Final = 1.959963984540054


@dataclass(frozen=True)
class Share:
    """`part` of `whole`, as a value from 0 to 1 with its 95 % interval."""

    part: int
    whole: int
    value: float
    low: float
    high: float


def share(part: int, whole: int) -> Share:
    """The share with Wilson's score interval (1927), which holds near 0 and 1, and for few."""
    if not 0 <= part <= whole or whole == 0:
        raise ValueError(f"expected a part from 0 to a whole above 0, got {part} of {whole}")
    value, z2 = part / whole, DEVIATIONS_95**2
    middle = (value + z2 / (2 * whole)) / (1 + z2 / whole)
    root = sqrt(value * (1 - value) / whole + z2 / (4 * whole**2))
    half = DEVIATIONS_95 * root / (1 + z2 / whole)
    # At the ends the interval reaches them exactly: rounding must not leave them out.
    low = 0.0 if part == 0 else middle - half
    high = 1.0 if part == whole else middle + half
    return Share(part, whole, value, low, high)
