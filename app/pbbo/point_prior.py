"""The same prior without its (n, n) covariance: each block is worked out when it is asked for.

For points that change from query to query, as in a box, and for candidates too many to keep their
covariance. Functions cannot be drawn from it, since that takes the factor of the whole.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from .candidates import FloatArray, IndexArray

# Share of the signal variance on the diagonal, so that points which nearly coincide factorise.
JITTER: Final = 1e-7


@dataclass(frozen=True, eq=False)
class PointPrior:
    """An RBF prior over points (n, d), and independent latent values behind them.

    extra: the prior variances of those, such as the threshold's.
    """

    points: FloatArray
    length_scale: float
    signal_variance: float
    extra: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.points) + len(self.extra)

    @property
    def variance(self) -> FloatArray:
        """Prior variance of each value; (n + extra,)."""
        own = np.full(len(self.points), (1.0 + JITTER) * self.signal_variance)
        return np.append(own, self.extra)

    def columns(self, rows: IndexArray) -> FloatArray:
        """Prior covariance of all values with these; (n + extra, rows)."""
        return self._between(np.arange(len(self)), rows)

    def block(self, rows: IndexArray) -> FloatArray:
        """Prior covariance of these values; (rows, rows)."""
        return self._between(rows, rows)

    def _between(self, rows: IndexArray, columns: IndexArray) -> FloatArray:
        n = len(self.points)
        out = np.zeros((len(rows), len(columns)))
        of_points, to_points = rows < n, columns < n
        covariance = cdist(
            self.points[rows[of_points]], self.points[columns[to_points]], "sqeuclidean"
        )
        covariance *= -0.5 / self.length_scale**2
        np.exp(covariance, out=covariance)
        covariance *= self.signal_variance
        out[np.ix_(of_points, to_points)] = covariance
        variance = np.append(np.full(n, JITTER * self.signal_variance), self.extra)
        same = rows[:, None] == columns[None, :]
        out[same] += np.broadcast_to(variance[rows][:, None], out.shape)[same]
        return out
