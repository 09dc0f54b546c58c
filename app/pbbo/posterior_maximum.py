"""The maximum of the posterior mean over a box, by gradient ascent from many starts at once."""

from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from .box import Box
from .box_design import projected
from .candidates import FloatArray
from .model_averaging import FittedScale

#: First step, and the step at which a start has arrived, as shares of the ranges.
FIRST_STEP: Final = 0.05
LAST_STEP: Final = 1e-5
STEPS: Final = 60
LONGER: Final = 1.4
SHORTER: Final = 0.35


class MeanFunction:
    """The posterior mean of a mixture at any place, with its gradient.

    seen: (p, d), kernel coordinates of the points in the data.
    """

    def __init__(
        self, seen: FloatArray, parts: list[FittedScale], weights: FloatArray, variance: float
    ) -> None:
        self._terms = []
        for part, weight in zip(parts, weights, strict=True):
            if part.learned is None:
                continue
            of_points = part.learned.seen < part.n
            pull = (part.learned.whiten.T @ part.learned.q.mean)[of_points]
            places = seen[part.learned.seen[of_points]]
            share = weight * (variance * part.signal)
            self._terms.append((places, share * pull, part.length_scale))

    def __call__(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (k,) and gradient (k, d) at kernel coordinates (k, d)."""
        mean, gradient = np.zeros(len(at)), np.zeros_like(at)
        for places, pull, length_scale in self._terms:
            share = np.exp(-0.5 * cdist(at, places, "sqeuclidean") / length_scale**2) * pull
            total = share.sum(axis=1)
            mean += total
            gradient += (share @ places - total[:, None] * at) / length_scale**2
        return mean, gradient


def ascend(box: Box, function: MeanFunction, starts: FloatArray) -> FloatArray:
    """Where projected gradient ascent from each start ends, in the box's units; (k, d).

    Each start has a step of its own: longer after a rise, shorter after a fall, which is undone.
    """
    here = box.kernel_coordinates(starts)
    mean, gradient = function(here)
    step = np.full(len(here), FIRST_STEP)
    for _ in range(STEPS):
        moving = step > LAST_STEP
        if not moving.any():
            break
        size = np.linalg.norm(gradient, axis=1, keepdims=True)
        ahead = here + step[:, None] * gradient / np.maximum(size, 1e-12)
        ahead = seen_by_kernel(box, projected(box, box.from_kernel_coordinates(ahead)))
        reached, slope = function(ahead)
        risen = (reached > mean) & moving
        here = np.where(risen[:, None], ahead, here)
        gradient = np.where(risen[:, None], slope, gradient)
        mean = np.where(risen, reached, mean)
        step = np.where(risen, LONGER * step, SHORTER * step)
    points = box.points(box.from_kernel_coordinates(here))
    return points[box.contains(points)]


def seen_by_kernel(box: Box, shares: FloatArray) -> FloatArray:
    """Kernel coordinates of shares of the ranges, whatever the steps; (n, d)."""
    low, high = np.array(box.low), np.array(box.high)
    return box.kernel_coordinates(low + shares * (high - low))
