"""The Gaussian process seen through answers, over all candidates (Eq. 9 to 12).

Every answer is a linear functional of the latent values at the few candidates it names. The fit
works on those values alone, whitened; what it learned reaches the other candidates through their
prior covariance with them, and sampled functions are prior draws moved by it (Matheron's rule), so
that nothing of the size of all candidates is factorised per step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import lapack

from .candidates import Candidates, FloatArray, IndexArray
from .comparisons import Tally, tally, whitened
from .errors import FitError
from .point_prior import PointPrior
from .preferences import Preference
from .prior import Prior, prior_over
from .settings import Settings
from .variational import Gaussian, fit

AnyPrior = Prior | PointPrior

# The posterior variance at a candidate is a difference; rounding may take it below zero.
SMALLEST_VARIANCE_SHARE: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Posterior:
    """q over all candidates.

    mean, std: (n,).  reach: (n, r), prior covariance of the candidates with the whitened variables
    z that the answers see.  whiten: (r, p), z = whiten @ f[seen].  seen: (p,), candidates in the
    data.  q: the Gaussian over z.
    """

    prior: AnyPrior
    mean: FloatArray
    std: FloatArray
    reach: FloatArray
    whiten: FloatArray
    seen: IndexArray
    q: Gaussian

    @property
    def bound(self) -> float:
        """The evidence lower bound, natural logarithm."""
        return self.q.bound

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Functions from the posterior over all candidates; (n, count)."""
        if not isinstance(self.prior, Prior):
            raise TypeError("draw: expected a prior that keeps its factor, got one that does not")
        prior = self.prior.draw(rng, count)
        if not len(self.seen):
            return prior
        noise = rng.standard_normal((count, len(self.q.mean))).T
        spread, _ = lapack.dtrtrs(self.q.root, noise, lower=1, trans=1)
        drawn = self.q.mean[:, None] + spread
        return np.asarray(prior + self.reach @ (drawn - self.whiten @ prior[self.seen]))

    def covariance(self, rows: IndexArray) -> FloatArray:
        """The posterior covariance of these values; (rows, rows)."""
        prior = self.prior.block(rows)
        if not len(self.seen):
            return prior
        reach = self.reach[rows]
        spread, _ = lapack.dtrtrs(self.q.root, reach.T, lower=1)
        return np.asarray(prior - reach @ reach.T + spread.T @ spread)


def belief_over(
    candidates: Candidates,
    preferences: Sequence[Preference],
    settings: Settings,
    prior: AnyPrior | None = None,
) -> Posterior:
    """What the settings make of these preferences, over all candidates; `FitError` if nothing.

    prior: one worked out before for these candidates and this signal variance, used again if its
    length scale is still the one wanted.
    """
    try:
        length_scale = settings.length_scale
        if settings.optimise_kernel and preferences:
            # PyTorch takes seconds to import; only this setting needs it.
            from .length_scale import best_length_scale  # noqa: PLC0415

            length_scale = best_length_scale(candidates.points, tally(preferences), settings)
        if prior is None or prior.length_scale != length_scale:
            prior = prior_over(candidates, length_scale, settings.signal_variance)
        if not preferences:
            return unlearned(prior)
        return posterior_of(prior, tally(preferences), settings.epsilon)
    except np.linalg.LinAlgError as error:
        raise FitError(f"model: {error} ({len(preferences)} preferences)") from error


def unlearned(prior: AnyPrior) -> Posterior:
    """The posterior given nothing: the prior."""
    n = len(prior)
    nothing = Gaussian(np.zeros(0), np.zeros((0, 0)), np.zeros(0), 0.0)
    return Posterior(
        prior=prior,
        mean=np.zeros(n),
        std=np.sqrt(prior.variance),
        reach=np.zeros((n, 0)),
        whiten=np.zeros((0, 0)),
        seen=np.zeros(0, dtype=np.intp),
        q=nothing,
    )


@dataclass(frozen=True, eq=False)
class Fit:
    """What was learned of the values compared: q over z = whiten @ f[seen]; see `Posterior`."""

    seen: IndexArray
    whiten: FloatArray
    q: Gaussian


def fitted(
    covariance: FloatArray, counted: Tally, epsilon: float, sharpness: FloatArray | float = 1.0
) -> Fit:
    """The fit to at least one comparison, or `FitError`; covariance: (p, p), prior, of those seen.

    sharpness: as for `whitened`.
    """
    data = whitened(counted, covariance, epsilon, sharpness)
    return Fit(counted.seen, data.whiten, fit(data.answers))


def posterior_over(prior: AnyPrior, learned: Fit) -> Posterior:
    """What the fit says of every value of the prior, in which its values are numbered alike."""
    q = learned.q
    reach = prior.columns(learned.seen) @ learned.whiten.T  # (n, r)
    spread, _ = lapack.dtrtrs(q.root, reach.T, lower=1)  # (r, n)
    own = prior.variance
    variance = own - np.einsum("ij,ij->i", reach, reach) + np.einsum("ij,ij->j", spread, spread)
    mean = reach @ q.mean
    if not (np.isfinite(mean).all() and np.isfinite(variance).all()):
        raise FitError("model: the posterior is not finite")
    std = np.sqrt(np.maximum(variance, SMALLEST_VARIANCE_SHARE * own))
    return Posterior(prior, mean, std, reach, learned.whiten, learned.seen, q)


def posterior_of(
    prior: AnyPrior, counted: Tally, epsilon: float, sharpness: FloatArray | float = 1.0
) -> Posterior:
    """The posterior over all values given at least one comparison, or `FitError`."""
    learned = fitted(prior.block(counted.seen), counted, epsilon, sharpness)
    return posterior_over(prior, learned)
