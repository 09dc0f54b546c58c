"""The Gaussian process prior over all candidates, worked out once per (candidates, kernel).

Zero mean, RBF kernel k(x, x') = s2 exp(-|x - x'|^2 / (2 l^2)). A tiny diagonal term makes the
covariance factorise where candidates nearly coincide; it is part of the prior, so that everything
computed from it agrees.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist

from .candidates import Candidates, FloatArray, IndexArray
from .errors import FitError

# Share of the signal variance on the diagonal: the first that factorises is taken.
JITTERS: Final = (1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5)
# A server replays many trials over the same few sets of candidates; at most this much is kept.
KEPT_PRIORS: Final = 8
LARGEST_KEPT: Final = 1000


@dataclass(frozen=True, eq=False)
class Prior:
    """covariance: (n, n);  root: (n, n) lower triangular, root root' = covariance."""

    length_scale: float
    covariance: FloatArray
    root: FloatArray

    def __len__(self) -> int:
        return len(self.covariance)

    @property
    def variance(self) -> FloatArray:
        """Prior variance of each value; (n,)."""
        return np.diagonal(self.covariance)

    def columns(self, rows: IndexArray) -> FloatArray:
        """Prior covariance of all values with these; (n, rows)."""
        return self.covariance[:, rows]

    def block(self, rows: IndexArray) -> FloatArray:
        """Prior covariance of these values; (rows, rows)."""
        return self.covariance[np.ix_(rows, rows)]

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Functions from the prior; (n, count)."""
        return self.root @ rng.standard_normal((count, len(self))).T


Key = tuple[bytes, tuple[int, ...], float, float]
_kept: OrderedDict[Key, Prior] = OrderedDict()


def prior_over(candidates: Candidates, length_scale: float, signal_variance: float) -> Prior:
    """The prior, from a small store of those used last (a pure function all the same)."""
    if len(candidates) > LARGEST_KEPT:
        return build(candidates.points, length_scale, signal_variance)
    key = (candidates.points.tobytes(), candidates.points.shape, length_scale, signal_variance)
    prior = _kept.get(key)
    if prior is None:
        prior = build(candidates.points, length_scale, signal_variance)
        _kept[key] = prior
        while len(_kept) > KEPT_PRIORS:
            _kept.popitem(last=False)
    return prior


def kernel(points: FloatArray, length_scale: float, signal_variance: float) -> FloatArray:
    """The RBF kernel between all pairs of points (n, d), without the diagonal term; (n, n)."""
    covariance = cdist(points, points, "sqeuclidean")
    covariance *= -0.5 / length_scale**2
    np.exp(covariance, out=covariance)
    covariance *= signal_variance
    return covariance


def build(points: FloatArray, length_scale: float, signal_variance: float) -> Prior:
    """The prior over points (n, d)."""
    covariance = kernel(points, length_scale, signal_variance)
    added = 0.0
    for jitter in JITTERS:
        covariance.flat[:: len(points) + 1] += jitter * signal_variance - added
        added = jitter * signal_variance
        root, info = lapack.dpotrf(covariance, lower=1, clean=1)
        if info == 0:
            return Prior(length_scale, covariance, np.ascontiguousarray(root))
    raise FitError(
        f"prior: expected a covariance that factorises, got none up to jitter {JITTERS[-1]:g} "
        f"({len(points)} candidates, length scale {length_scale:g})"
    )
