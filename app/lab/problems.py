"""Problems to compare preference optimisers on: the crane's two worlds and three that are not it.

Branin, Ackley in 4 and Hartmann in 6 dimensions are the usual functions, each over 500 quasi-random
candidates (Sobol), with the sign turned so that larger is better. An evaluator of any of them skips
when both values lie below the mean over the candidates, and is as consistent as with Env1: eta
times the standard deviation of g is the same.
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
from app.crane.environments import candidates
from app.lab.evaluators import ETA, Uncertain

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
#: Half the side of Ackley's usual cube.
ACKLEY_REACH: Final = 32.768


@dataclass(frozen=True, eq=False)
class Problem:
    """candidates: (n, d). scores: (n, runs), g of each run. eta: the evaluator's steepness."""

    name: str
    candidates: FloatArray
    scores: FloatArray
    eta: float

    @property
    def f(self) -> FloatArray:
        """The mean of g over the runs of each candidate, (n,)."""
        return np.asarray(self.scores.mean(axis=1))

    def regret(self, candidate: int) -> float:
        """f(w*) - f of this candidate."""
        return float(self.f.max() - self.f[candidate])

    def evaluator(self, rng: np.random.Generator) -> Uncertain:
        """Who answers: Bradley and Terry, skipping below the mean of g."""
        return Uncertain(rng, skip_below=float(self.scores.mean()), eta=self.eta)


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
def crane(environment: str) -> Problem:
    """One of the crane's worlds, with its five runs of each candidate."""
    return Problem(environment, candidates(), library.scores(environment), ETA)


@cache
def quasi_random(
    name: str, function: Callable[[FloatArray], FloatArray], dimensions: int
) -> Problem:
    """A function over quasi-random candidates, as hard to judge as Env1."""
    unit = qmc.Sobol(dimensions, seed=SOBOL_SEED).random(SOBOL_POINTS)[:CANDIDATES]
    scores = function(unit)[:, None]
    eta = ETA * float(library.scores("env1").std() / scores.std())
    return Problem(name, unit, scores, eta)


PROBLEMS: Final[dict[str, Callable[[], Problem]]] = {
    "env1": lambda: crane("env1"),
    "env2": lambda: crane("env2"),
    "branin": lambda: quasi_random("branin", branin, 2),
    "ackley4": lambda: quasi_random("ackley4", ackley, 4),
    "hartmann6": lambda: quasi_random("hartmann6", hartmann, 6),
}
