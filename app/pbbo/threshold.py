"""The evaluator's threshold and tie width as latent values: what skips and choices say about them.

The paper turns a skip into preferences for a candidate drawn from those chosen before (Section
IV-B). A skip of (A, B) because both are bad says something else: f(A) < t and f(B) < t for a
threshold t of this evaluator. A choice of A over B says f(A) > f(B), and that not both lie below t,
so probably f(A) > t.

A skip because the evaluator cannot tell is a tie: |f(A) - f(B)| < delta for a tie width delta of
this evaluator (Rao and Kupper 1967, with a probit). It is taken as two comparisons,
f(A) - f(B) < delta and f(B) - f(A) < delta; and once there is a tie, a choice of A over B says
f(A) - f(B) > delta. While there is none, delta has no part in a choice.

t and delta get Gaussian priors of their own, independent of f, and the places behind the last
candidate. Then all of these are probit observations of a linear functional of latent values, as
every answer is, and the same inference serves. A comparison with t has less noise than one of two
candidates: one run is seen against what is expected of any, and no two have to be weighed against
each other.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from .candidates import FloatArray
from .comparisons import Comparison, Tally
from .preferences import Preference
from .prior import KEPT_PRIORS, Prior
from .skip_synthesis import Skip

# Prior variance of the threshold as a share of the signal variance: it may lie anywhere among the
# candidates' values.
VARIANCE_SHARE: Final = 1.0
# Prior variance of the tie width as a share of the signal variance. Its prior mean is zero; ties
# raise it.
TIE_VARIANCE_SHARE: Final = 0.25


def with_threshold(
    preferences: Sequence[Preference],
    skips: Sequence[Skip],
    n: int,
    excluded: Sequence[int] = (),
) -> list[Comparison]:
    """Answers and skips as comparisons of n candidates, the threshold, number n, and the tie width.

    excluded: candidates that lie below the threshold for a reason of their own.
    """
    margin = -1 if any(skip.reason == "cannot_tell" for skip in skips) else 0
    comparisons: list[Comparison] = []
    for answer in preferences:
        comparisons.append(Comparison(answer.winner, answer.loser, margin))
        comparisons.append(Comparison(answer.winner, n))
    for skip in skips:
        if skip.reason == "cannot_tell":
            comparisons.append(Comparison(skip.left, skip.right, 1))
            comparisons.append(Comparison(skip.right, skip.left, 1))
        else:
            comparisons += [Comparison(n, below) for below in (skip.left, skip.right)]
    comparisons += [Comparison(n, below) for below in excluded]
    return comparisons


def sharpness(counted: Tally, n: int, noise: float) -> FloatArray:
    """1 for a comparison of two candidates, 1 / noise for one with the threshold, number n; (m,).

    noise: of a comparison with the threshold, as a share of that of two candidates.
    """
    threshold = counted.seen == n  # (p,)
    return np.where(threshold[counted.winner] | threshold[counted.loser], 1.0 / noise, 1.0)


def latent_variances(signal_variance: float) -> tuple[float, float]:
    """Prior variances of the threshold and of the tie width."""
    return VARIANCE_SHARE * signal_variance, TIE_VARIANCE_SHARE * signal_variance


# Priors are kept by `prior_over` and are the same object from step to step; so are these.
@lru_cache(maxsize=KEPT_PRIORS)
def prior_with_threshold(prior: Prior, signal_variance: float) -> Prior:
    """The prior over all candidates and, behind them, the threshold and tie width; (n + 2)."""
    covariance, root = prior.covariance, prior.root
    for variance in latent_variances(signal_variance):
        covariance = bordered(covariance, variance)
        root = bordered(root, float(np.sqrt(variance)))
    return Prior(prior.length_scale, covariance, root)


def bordered(matrix: FloatArray, corner: float) -> FloatArray:
    """One row and column of zeros more, with `corner` where they meet; (n + 1, n + 1)."""
    n = len(matrix)
    out = np.zeros((n + 1, n + 1))
    out[:n, :n] = matrix
    out[n, n] = corner
    return out
