"""A first phase that covers the space, in place of random pairs.

Farthest-point sampling: from a candidate drawn at random, always the one farthest from all taken so
far. It reaches edges and corners early, where a Gaussian process knows least and would otherwise
send later queries; random pairs leave whole regions unseen. In more than two dimensions there are
too many edges and corners for this to pay, so it is off unless asked for.
"""

import numpy as np

from .candidates import FloatArray, IndexArray


def farthest_points(rng: np.random.Generator, points: FloatArray, count: int) -> IndexArray:
    """Rows of `points` (n, d) that cover it, at most `count`, in random order."""
    taken = [int(rng.integers(len(points)))]
    nearest = np.full(len(points), np.inf)
    while len(taken) < min(count, len(points)):
        away = points - points[taken[-1]]
        nearest = np.minimum(nearest, np.einsum("ij,ij->i", away, away))
        taken.append(int(np.argmax(nearest)))
    return rng.permutation(np.array(taken, dtype=np.intp))
