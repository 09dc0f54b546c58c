"""A model of safety: how likely a machine can run a point, learnt from points run and refused.

A correlated beta process (Goetschalckx, Poupart and Hoey, "Continuous correlated beta processes",
IJCAI 2011): each label counts at a point with the weight of a Gaussian kernel of its distance, so
that the probability of safety is

    (PRIOR + sum of the weights of safe labels) / (PRIOR + sum of the weights of all labels).

The prior says that what is far from every refused point is safe.
"""

from typing import Final

import numpy as np

from .box import Box
from .candidates import FloatArray

#: Safe labels that every point is worth before there is any.
PRIOR: Final = 0.25
#: Standard deviation of the kernel as a share of the ranges, for two parameters.
REACH: Final = 0.1
#: A point that is less likely to be safe is no first choice, and not acquired, if there are others.
LIKELY: Final = 0.5


class Safety:
    """The probability that points of a box are safe.

    run: (r, d), points that were run. refused: (u, d), points that must not be run; they count as
    such even if they were run before.
    """

    def __init__(self, box: Box, run: FloatArray, refused: FloatArray) -> None:
        self._box = box
        barred = set(box.keys(refused))
        safe = [key not in barred for key in box.keys(run)]
        self._run = {key for key in box.keys(run) if key not in barred}
        self._safe = box.kernel_coordinates(run[safe])
        self._unsafe = box.kernel_coordinates(refused)

    @property
    def is_in_doubt(self) -> bool:
        """Whether any point was refused; otherwise every point is safe with probability 1."""
        return len(self._unsafe) > 0

    def probability(self, points: FloatArray) -> FloatArray:
        """Of each point (n, d), in the box's units; (n,). 1 for a point that was run."""
        if not self.is_in_doubt:
            return np.ones(len(points))
        seen = self._box.kernel_coordinates(points)
        safe = PRIOR + self._weights(seen, self._safe)
        found = safe / (safe + self._weights(seen, self._unsafe))
        found[[key in self._run for key in self._box.keys(points)]] = 1.0
        return np.asarray(found)

    def _weights(self, seen: FloatArray, labelled: FloatArray) -> FloatArray:
        """The sum of the weights of these labels at each point; (n,)."""
        reach = REACH * np.sqrt(self._box.dimensions / 2.0)
        distance = ((seen[:, None, :] - labelled[None, :, :]) ** 2).sum(axis=2)
        return np.asarray(np.exp(-0.5 * distance / reach**2).sum(axis=1))
