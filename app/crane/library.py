"""All recorded runs of the crane world: five seeded runs of each candidate (Sec. V-C)."""

from __future__ import annotations

from functools import cache

import numpy as np

from app.crane.dynamics import Run, simulate
from app.crane.environments import FloatArray, candidates, environment_named, run_rng
from app.crane.evaluation import score

RUNS_PER_CANDIDATE = 5


def run(environment: str, candidate_index: int, run_index: int) -> Run:
    """The recorded run ``run_index`` of a candidate: the same bytes each time."""
    w0, w1 = candidates()[candidate_index]
    rng = run_rng(environment, candidate_index, run_index)
    return simulate(environment_named(environment), (float(w0), float(w1)), rng)


@cache
def series(environment: str) -> FloatArray:
    """The weight series of all runs, (231, 5, 501), in grams."""
    weights = np.array(
        [
            [run(environment, index, k).weight for k in range(RUNS_PER_CANDIDATE)]
            for index in range(len(candidates()))
        ]
    )
    weights.setflags(write=False)
    return weights


@cache
def scores(environment: str) -> FloatArray:
    """g of all runs, (231, 5)."""
    values = score(series(environment))
    values.setflags(write=False)
    return values
