"""Cranes drawn at random from the ranges of the calibration (`app.crane.search`).

The two shipped environments were fitted to two published ones, and every setting that is chosen on
them may be right for them alone. Twenty drawn cranes guard against that: ten to choose settings on,
ten to decide on. Half of them drop clumps like Env1, half pour grains like Env2.

Many points of the ranges give a crane that drops nothing, or everything at once, whatever the
candidate. A drawn crane is kept if its best candidate is better than the mean candidate by at least
`LEAST_TO_FIND`, estimated from few runs, and if the best of them is good: at least `LEAST_BEST`.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from app.crane.environments import Environment, FloatArray, candidates
from app.crane.search import RANGES, build

from .fast_runs import runs_at_once

#: How many cranes settings are chosen on, and how many they are decided on; half of each kind.
CHOOSING: Final = 10
DECIDING: Final = 10
DRAW_SEED: Final = 15
#: The grasped weight in grams, about that of both shipped environments (248 and 253).
WEIGHT: Final = 250.0
#: f(w*) less the mean of f over W, in grams: below, there is nothing to find.
LEAST_TO_FIND: Final = 25.0
#: f(w*) in grams: below, no candidate comes near the ideal, and no study would be run.
LEAST_BEST: Final = -70.0
#: Runs of each candidate in the estimate.
GLANCE: Final = 25


@cache
def drawn_crane(number: int) -> Environment:
    """The drawn crane of this number, from 0; even numbers drop clumps, odd ones pour grains."""
    kind = ("env1", "env2")[number % 2]
    rng = np.random.default_rng([DRAW_SEED, number])
    while True:
        crane = build(kind, rng.random(len(RANGES[kind])), WEIGHT)
        f = glance(crane)
        if f.max() - f.mean() >= LEAST_TO_FIND and f.max() >= LEAST_BEST:
            return crane


def glance(environment: Environment) -> FloatArray:
    """f of every candidate from a few runs, in grams; (231,)."""
    rng = np.random.default_rng([DRAW_SEED])
    space = [(float(w0), float(w1)) for w0, w1 in candidates()]
    return np.array([runs_at_once(environment, w, rng, GLANCE).mean() for w in space])
