"""The kernel's length scale, chosen by the evidence lower bound (Section III-B).

q and the length scale are optimised in turn, as in the paper: q by the variational fit, then the
length scale along the bound's derivative with q's natural parameters held, which automatic
differentiation gives. At a converged q that derivative is the bound's total one, so a zero of it
between a rise and a fall is a local maximum of the bound over both.
"""

from math import exp, log
from typing import Any, Final

import numpy as np
import torch
from scipy.optimize import brentq
from scipy.spatial.distance import cdist

from .candidates import FloatArray
from .comparisons import Tally, whitened
from .prior import kernel
from .probit import expectations
from .settings import Settings
from .variational import fit

# Shortest and longest length scale looked at, as shares of the candidates' diagonal: below, no
# candidate tells about another; above, every function over them is a plane.
SHORTEST_SHARE: Final = 0.01
LONGEST_SHARE: Final = 2.0
# First step of the search, and where it ends, in log length scale.
FIRST_STEP: Final = 0.5
CLOSE_ENOUGH: Final = 0.01
MOST_FITS: Final = 30
# Share of the signal variance on the diagonal, as for the prior over all candidates.
JITTER: Final = 1e-8


class ExpectedLogProbit(torch.autograd.Function):
    """E[log Phi(x)], x ~ N(a, b^2), with the derivatives that `probit` knows in closed form."""

    @staticmethod
    def forward(ctx: Any, a: torch.Tensor, variance: torch.Tensor) -> torch.Tensor:
        e = expectations(a.detach().numpy(), np.sqrt(variance.detach().numpy()))
        ctx.save_for_backward(torch.from_numpy(e.slope), torch.from_numpy(e.curvature))
        return torch.from_numpy(e.value.copy())

    @staticmethod
    def backward(ctx: Any, *grads: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        slope, curvature = ctx.saved_tensors
        # Price's theorem: the derivative in the variance is half the expected second derivative.
        return grads[0] * slope, grads[0] * (-0.5 * curvature)


def best_length_scale(points: FloatArray, tally: Tally, settings: Settings) -> float:
    """The length scale at the nearest maximum of the bound, uphill from the one in the settings."""
    diagonal = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    lowest, highest = log(SHORTEST_SHARE * diagonal), log(LONGEST_SHARE * diagonal)
    seen = points[tally.seen]

    def slope(place: float) -> float:
        return bound_and_slope(seen, tally, settings, exp(place))[1]

    here = min(max(log(settings.length_scale), lowest), highest)
    uphill = slope(here)
    if uphill == 0.0:
        return exp(here)
    step = FIRST_STEP if uphill > 0.0 else -FIRST_STEP
    for _ in range(MOST_FITS):
        there = min(max(here + step, lowest), highest)
        ahead = slope(there)
        if ahead * uphill <= 0.0:
            return exp(brentq(slope, here, there, xtol=CLOSE_ENOUGH, maxiter=MOST_FITS))
        if there in (lowest, highest):
            return exp(there)
        here, uphill, step = there, ahead, 2.0 * step
    return exp(here)


def bound_and_slope(
    seen: FloatArray, tally: Tally, settings: Settings, length_scale: float
) -> tuple[float, float]:
    """The bound at its best q for this length scale, and its derivative in log length scale.

    seen: (p, d), the candidates in the data.
    """
    covariance = kernel(seen, length_scale, settings.signal_variance)
    covariance.flat[:: len(seen) + 1] += JITTER * settings.signal_variance
    data = whitened(tally, covariance, settings.epsilon)
    q = fit(data.answers)
    features, scale = data.answers.features, data.answers.scale

    # q's natural parameters, per answer: they stay what they are while the kernel moves.
    seen_mean = features @ q.mean
    spread = np.linalg.solve(q.root, features.T)
    width = np.sqrt(np.einsum("ij,ij->j", spread, spread))
    pull = tally.counts * expectations(seen_mean / scale, width / scale).slope / scale
    natural = torch.from_numpy(pull + q.sites * seen_mean)
    sites = torch.from_numpy(q.sites.copy())
    counts = torch.from_numpy(tally.counts)

    place = torch.tensor(log(length_scale), dtype=torch.float64, requires_grad=True)
    distance = torch.from_numpy(cdist(seen, seen, "sqeuclidean"))  # (p, p)
    prior = settings.signal_variance * (
        torch.exp(-0.5 * distance * torch.exp(-2.0 * place))
        + JITTER * torch.eye(len(seen), dtype=torch.float64)
    )
    rows = prior[tally.winner] - prior[tally.loser]
    gram = rows[:, tally.winner] - rows[:, tally.loser]  # (m, m), prior of the differences
    root_sites = torch.sqrt(sites)
    system = torch.eye(len(sites), dtype=torch.float64) + root_sites[:, None] * gram * root_sites
    root = torch.linalg.cholesky(system)
    half = torch.linalg.solve_triangular(root, root_sites[:, None] * gram, upper=False)
    posterior = gram - half.T @ half
    mean = posterior @ natural
    variance = torch.diagonal(posterior)
    dual = natural - sites * mean
    expected = ExpectedLogProbit.apply(mean / scale, variance / scale**2)  # type: ignore[no-untyped-call]
    divergence = (
        2.0 * torch.log(torch.diagonal(root)).sum() - (sites * variance).sum() + (dual * mean).sum()
    )
    bound = (counts * expected).sum() - 0.5 * divergence
    bound.backward()
    assert place.grad is not None
    return float(bound.detach()), float(place.grad)
