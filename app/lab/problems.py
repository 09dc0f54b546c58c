"""Problems to compare preference optimisers on: cranes and three functions that are no crane.

Cranes: the two shipped environments and twenty drawn ones. An evaluator of them sees a fresh run of
a candidate each time, and f is the mean of 400 such runs. `env1-recorded` and `env2-recorded` show
the five recorded runs instead, as studies do, and are judged by the same f.

Branin, Ackley in 4 and Hartmann in 6 dimensions are the usual functions, each over 500 quasi-random
candidates (Sobol), with the sign turned so that larger is better. An evaluator of them is as
consistent as with Env1: eta times the standard deviation of g is the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from app.crane import library
from app.crane.environments import Environment, candidates, environment_named

from .drawn_cranes import CHOOSING, DECIDING, drawn_crane
from .evaluators import ETA
from .fresh_runs import fresh_scores

FloatArray = NDArray[np.float64]

CANDIDATES: Final = 500
#: Of the quasi-random candidates; the sequence has its balance in powers of two.
SOBOL_SEED: Final = 0
SOBOL_POINTS: Final = 512

HARTMANN_WEIGHTS: Final = np.array([1.0, 1.2, 3.0, 3.2])
HARTMANN_WIDTHS: Final = np.array(
    [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ]
)
HARTMANN_CENTRES: Final = 1e-4 * np.array(
    [
        [1312.0, 1696.0, 5569.0, 124.0, 8283.0, 5886.0],
        [2329.0, 4135.0, 8307.0, 3736.0, 1004.0, 9991.0],
        [2348.0, 1451.0, 3522.0, 2883.0, 3047.0, 6650.0],
        [4047.0, 8828.0, 8732.0, 5743.0, 1091.0, 381.0],
    ]
)
#: A regret above this is a failure, in grams; for functions, the same share of the deviation of g.
FAILURE_G: Final = 30.0
#: Half the side of Ackley's usual cube.
ACKLEY_REACH: Final = 32.768


@dataclass(frozen=True, eq=False)
class Problem:
    """candidates: (n, d). scores: (n, runs), g of each run that evaluators may be shown.
    f: (n,), the true value of each candidate. eta: steepness of the paper's uncertain evaluator.
    failure: a regret above this is a failure.
    """

    name: str
    candidates: FloatArray
    scores: FloatArray
    f: FloatArray
    eta: float
    failure: float

    @property
    def mean(self) -> float:
        """Mean of g over the search space."""
        return float(self.scores.mean())

    @property
    def deviation(self) -> float:
        """Standard deviation of g over the search space."""
        return float(self.scores.std())

    def regret(self, candidate: int) -> float:
        """f(w*) - f of this candidate."""
        return float(self.f.max() - self.f[candidate])


def branin(unit: FloatArray) -> FloatArray:
    """Three equal maxima of -0.398, over [-5, 10] x [0, 15] scaled to the unit square; (n,)."""
    x, y = 15.0 * unit[:, 0] - 5.0, 15.0 * unit[:, 1]
    bowl = y - 5.1 / (4.0 * np.pi**2) * x**2 + 5.0 / np.pi * x - 6.0
    return np.asarray(-(bowl**2 + 10.0 * (1.0 - 1.0 / (8.0 * np.pi)) * np.cos(x) + 10.0))


def ackley(unit: FloatArray) -> FloatArray:
    """One maximum of 0 in the middle of the unit cube, among many lower ones; (n,)."""
    x = ACKLEY_REACH * (2.0 * unit - 1.0)
    far = 20.0 * np.exp(-0.2 * np.sqrt((x**2).mean(axis=1)))
    return np.asarray(far + np.exp(np.cos(2.0 * np.pi * x).mean(axis=1)) - 20.0 - np.e)


def hartmann(unit: FloatArray) -> FloatArray:
    """Six maxima, the largest 3.322; (n,)."""
    away = HARTMANN_WIDTHS * (unit[:, None, :] - HARTMANN_CENTRES) ** 2
    return np.asarray(np.exp(-away.sum(axis=2)) @ HARTMANN_WEIGHTS)


@cache
def fresh_crane(name: str, environment: Environment) -> Problem:
    """A crane of which every run shown is a fresh one."""
    scores = fresh_scores(environment)
    return Problem(name, candidates(), scores, scores.mean(axis=1), ETA, FAILURE_G)


@cache
def recorded_crane(name: str) -> Problem:
    """A shipped environment whose five recorded runs are shown; f is that of the fresh runs."""
    f = fresh_scores(environment_named(name)).mean(axis=1)
    return Problem(f"{name}-recorded", candidates(), library.scores(name), f, ETA, FAILURE_G)


@cache
def quasi_random(
    name: str, function: Callable[[FloatArray], FloatArray], dimensions: int
) -> Problem:
    """A function over quasi-random candidates, as hard to judge as Env1."""
    unit = qmc.Sobol(dimensions, seed=SOBOL_SEED).random(SOBOL_POINTS)[:CANDIDATES]
    f = function(unit)
    env1 = float(library.scores("env1").std())
    scale = env1 / float(f.std())
    return Problem(name, unit, f[:, None], f, ETA * scale, FAILURE_G / scale)


CHOOSING_CRANES: Final = tuple(f"crane-{k:02d}" for k in range(CHOOSING))
DECIDING_CRANES: Final = tuple(f"crane-{k:02d}" for k in range(CHOOSING, CHOOSING + DECIDING))
FUNCTIONS: Final = ("branin", "ackley4", "hartmann6")

PROBLEMS: Final[dict[str, Callable[[], Problem]]] = {
    "env1": lambda: fresh_crane("env1", environment_named("env1")),
    "env2": lambda: fresh_crane("env2", environment_named("env2")),
    "env1-recorded": lambda: recorded_crane("env1"),
    "env2-recorded": lambda: recorded_crane("env2"),
    **{
        name: lambda name=name: fresh_crane(name, drawn_crane(int(name[-2:])))  # type: ignore[misc]
        for name in (*CHOOSING_CRANES, *DECIDING_CRANES)
    },
    "branin": lambda: quasi_random("branin", branin, 2),
    "ackley4": lambda: quasi_random("ackley4", ackley, 4),
    "hartmann6": lambda: quasi_random("hartmann6", hartmann, 6),
}
