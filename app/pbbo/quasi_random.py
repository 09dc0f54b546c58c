"""A first phase of scrambled Sobol points, in place of random pairs.

Scrambled Sobol points fill the unit cube more evenly than random ones in any number of dimensions,
and unlike farthest points they do not gather in its corners. Each is given to the nearest candidate
that has none yet, so that where the candidates fill only a part of the cube, those on the edge of
that part are taken more often.
"""

import numpy as np

from .candidates import FloatArray, IndexArray


def quasi_random_candidates(rng: np.random.Generator, points: FloatArray, count: int) -> IndexArray:
    """Rows of `points` (n, d) nearest to scrambled Sobol points, at most `count`, in random
    order."""
    # SciPy's statistics take long to import.
    from scipy.stats import qmc  # noqa: PLC0415

    low, high = points.min(axis=0), points.max(axis=0)
    # The sequence has its balance in powers of two.
    sampler = qmc.Sobol(points.shape[1], scramble=True, rng=rng)
    drawn = sampler.random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    free = np.ones(len(points), dtype=bool)
    rows = []
    for place in (low + drawn * (high - low))[: len(points)]:
        away = np.einsum("ij,ij->i", points - place, points - place)
        row = int(np.argmin(np.where(free, away, np.inf)))
        free[row] = False
        rows.append(row)
    return rng.permutation(np.array(rows, dtype=np.intp))
