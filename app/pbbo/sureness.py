"""How sure the belief is of its best candidate, from functions drawn from it.

A drawn function is one of the landscapes that the answers leave possible. The share of them under
which no candidate is better than the acquired one by more than a stated amount is the probability
that the trial has found what it was for. The candidates that are best under most of them make the
set that holds the best one with a stated probability. docs/optimiser.md has the calibration.
"""

from typing import Final

import numpy as np

from .candidates import FloatArray, IndexArray
from .model import Posterior
from .model_averaging import Average, joint_draws

#: Functions drawn: a probability of 0.5 has a standard error of 2.2 %, one of 0.95 of 1 %.
DRAWS: Final = 500
#: Of more candidates than this, those with the largest upper bounds are drawn at, since a draw at n
#: candidates takes the factor of an (n, n) covariance.
MOST_ROWS: Final = 600
#: The same in a box, whose design is denser than what a draw can tell apart.
MOST_POINTS: Final = 200
#: Deviations above the mean of that upper bound.
UPPER: Final = 3.0


class Landscapes:
    """Functions drawn at the candidates that may matter.

    Drawn at most at `most` of the candidates `rows`, `best` among them.

    rows: (k,), those drawn at.  values: (k, draws).
    """

    def __init__(
        self,
        belief: Posterior | Average,
        rows: IndexArray,
        best: int,
        rng: np.random.Generator,
        most: int = MOST_ROWS,
    ) -> None:
        if len(rows) > most:
            bound = belief.mean[rows] + UPPER * belief.std[rows]
            lowest = rows[np.argmin(belief.mean[rows])]
            rows = rows[np.argsort(-bound, kind="stable")[: most - 2]]
            # The range of a function needs its lowest candidate too.
            rows = np.unique(np.append(rows, [best, lowest]))
        self.rows: IndexArray = rows
        self.values: FloatArray = joint_draws(belief, rng, DRAWS, rows)

    def sureness(self, best: int, within: float) -> float:
        """The share of functions of which no value exceeds that at `best` by more than `within` of
        the function's range."""
        highest, lowest = self.values.max(axis=0), self.values.min(axis=0)
        at_best = self.values[int(np.flatnonzero(self.rows == best)[0])]
        return float(np.mean(highest - at_best <= within * (highest - lowest)))

    def may_be_best(self, probability: float) -> tuple[int, ...]:
        """The fewest candidates that hold the best one in this share of functions."""
        winners = self.rows[np.argmax(self.values, axis=0)]
        candidates, counts = np.unique(winners, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        enough = int(np.searchsorted(np.cumsum(counts[order]), probability * DRAWS - 1e-9)) + 1
        return tuple(int(candidate) for candidate in candidates[order][:enough])
