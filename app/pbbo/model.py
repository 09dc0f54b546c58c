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

from app.pbbo.candidates import Candidates, FloatArray, IndexArray
from app.pbbo.errors import FitError
from app.pbbo.preferences import Preference
from app.pbbo.prior import Prior, prior_over
from app.pbbo.settings import Settings
from app.pbbo.variational import Answers, Gaussian, fit

# The posterior variance at a candidate is a difference; rounding may take it below zero.
SMALLEST_VARIANCE_SHARE: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Posterior:
    """q over all candidates.

    mean, std: (n,).  reach: (n, r), prior covariance of the candidates with the whitened variables
    z that the answers see.  whiten: (r, p), z = whiten @ f[seen].  seen: (p,), candidates in the
    data.  q: the Gaussian over z.
    """

    prior: Prior
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
        prior = self.prior.draw(rng, count)
        if not len(self.seen):
            return prior
        noise = rng.standard_normal((count, len(self.q.mean))).T
        spread, _ = lapack.dtrtrs(self.q.root, noise, lower=1, trans=1)
        drawn = self.q.mean[:, None] + spread
        return np.asarray(prior + self.reach @ (drawn - self.whiten @ prior[self.seen]))


def belief_over(
    candidates: Candidates, preferences: Sequence[Preference], settings: Settings
) -> Posterior:
    """What the settings make of these preferences, over all candidates; `FitError` if nothing."""
    prior = prior_over(candidates, settings.length_scale, settings.signal_variance)
    if not preferences:
        return unlearned(prior)
    return posterior_of(prior, preferences, settings.epsilon)


def unlearned(prior: Prior) -> Posterior:
    """The posterior given nothing: the prior."""
    n = len(prior)
    nothing = Gaussian(np.zeros(0), np.zeros((0, 0)), np.zeros(0), 0.0)
    return Posterior(
        prior=prior,
        mean=np.zeros(n),
        std=np.sqrt(np.diagonal(prior.covariance)),
        reach=np.zeros((n, 0)),
        whiten=np.zeros((0, 0)),
        seen=np.zeros(0, dtype=np.intp),
        q=nothing,
    )


def posterior_of(prior: Prior, preferences: Sequence[Preference], epsilon: float) -> Posterior:
    """The posterior over all candidates given at least one preference, or `FitError`."""
    winners, losers, counts = tally(preferences)
    seen, place = np.unique(np.concatenate([winners, losers]), return_inverse=True)
    place = place.reshape(2, -1)
    root, info = lapack.dpotrf(prior.covariance[np.ix_(seen, seen)], lower=1, clean=1)
    if info != 0:
        raise FitError(f"model: the covariance of {len(seen)} candidates does not factorise")
    inverse_root, _ = lapack.dtrtri(root, lower=1)

    features = root[place[0]] - root[place[1]]  # (m, p)
    whiten = inverse_root  # (p, p)
    if len(features) < len(seen):
        # Fewer answers than candidates in them: only their span matters.
        basis, triangle = np.linalg.qr(features.T)
        features = np.ascontiguousarray(triangle.T)  # (m, m)
        whiten = basis.T @ inverse_root  # (m, p)
    q = fit(Answers(features, counts, np.sqrt(2.0) * epsilon))

    reach = prior.covariance[:, seen] @ whiten.T  # (n, r)
    spread, _ = lapack.dtrtrs(q.root, reach.T, lower=1)  # (r, n)
    own = np.diagonal(prior.covariance)
    variance = own - np.einsum("ij,ij->i", reach, reach) + np.einsum("ij,ij->j", spread, spread)
    mean = reach @ q.mean
    if not (np.isfinite(mean).all() and np.isfinite(variance).all()):
        raise FitError("model: the posterior is not finite")
    std = np.sqrt(np.maximum(variance, SMALLEST_VARIANCE_SHARE * own))
    return Posterior(prior, mean, std, reach, whiten, seen, q)


def tally(preferences: Sequence[Preference]) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Different (winner, loser) pairs and how often each was given; each (m,).

    Sorted, so that the order of the answers does not reach the arithmetic.
    """
    pairs = np.array([(p.winner, p.loser) for p in preferences], dtype=np.intp)
    different, counts = np.unique(pairs, axis=0, return_counts=True)
    return different[:, 0], different[:, 1], counts.astype(np.float64)
