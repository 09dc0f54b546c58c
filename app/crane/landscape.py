"""The published figures of g and f over the search space, and the same of a simulated world.

Sec. V-C and Fig. 9 give the figures; the tolerances are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from .environments import FloatArray, candidates
from .evaluation import objective

MEAN_TOLERANCE = 2.0  # g
DEVIATION_TOLERANCE = 3.0  # g
BEST_TOLERANCE = 2.0  # g
BEST_CANDIDATE_TOLERANCE_S = 0.1  # in each coordinate
# Shape, read off Fig. 9 and Sec. V-C: a wide area of high values in Env1, a lone peak in Env2.
ENV1_HIGH_VALUE = -45.0  # g
ENV1_HIGH_AT_LEAST = 12
ENV2_FIVE_BEST_ABOVE = -75.0  # g
ENV2_MIDDLING_VALUE = -95.0  # g
ENV2_MIDDLING_AT_MOST = 20


@dataclass(frozen=True)
class Published:
    """What the paper reports of one environment."""

    best_candidate: tuple[float, float]  # w*, s
    best: float  # f(w*), g
    mean: float  # of g over all runs, g
    deviation: float  # of g over all runs, g


PUBLISHED: Mapping[str, Published] = MappingProxyType(
    {
        "env1": Published(best_candidate=(0.95, 0.6), best=-33.7, mean=-69.7, deviation=23.4),
        "env2": Published(best_candidate=(0.1, 0.1), best=-46.2, mean=-125.7, deviation=20.0),
    }
)


@dataclass(frozen=True)
class Landscape:
    """The same figures of a simulated environment, and the shape of f."""

    best_candidate: tuple[float, float]  # w*, s
    best: float  # f(w*), g
    mean: float  # of g over all runs, g
    deviation: float  # of g over all runs, g
    spread: float  # standard deviation of g over a candidate's runs, mean over candidates, g
    fifth_best: float  # f of the fifth best candidate, g
    high: int  # candidates with f above ENV1_HIGH_VALUE
    middling: int  # candidates with f above ENV2_MIDDLING_VALUE


def landscape(scores: FloatArray) -> Landscape:
    """Summarise g of all runs, (231, runs)."""
    f = objective(scores)
    best = int(np.argmax(f))
    w0, w1 = candidates()[best]
    return Landscape(
        best_candidate=(float(w0), float(w1)),
        best=float(f[best]),
        mean=float(scores.mean()),
        deviation=float(scores.std()),
        spread=float(scores.std(axis=1).mean()),
        fifth_best=float(np.sort(f)[-5]),
        high=int(np.count_nonzero(f > ENV1_HIGH_VALUE)),
        middling=int(np.count_nonzero(f > ENV2_MIDDLING_VALUE)),
    )
