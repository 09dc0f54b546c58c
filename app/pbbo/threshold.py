"""An acceptability threshold as one more latent value: what a skip and a choice say about it.

The paper turns a skip into preferences for a candidate drawn from those chosen before (Section
IV-B). A skip of (A, B), offered only as "both are undesirable", says something else: f(A) < t and
f(B) < t for a threshold t of this evaluator. A choice of A over B says f(A) > f(B), and that not
both lie below t, so probably f(A) > t.

t gets a Gaussian prior, independent of f, and the place behind the last candidate. Then all of
these are probit observations of a difference of two latent values, as every answer is, and the same
inference serves. A comparison with t has less noise than one of two candidates: one run is seen
against what is expected of any, and no two have to be weighed against each other.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from app.pbbo.candidates import FloatArray
from app.pbbo.comparisons import Tally
from app.pbbo.preferences import Preference
from app.pbbo.prior import KEPT_PRIORS, Prior
from app.pbbo.synthesis import Skip

# Prior variance of the threshold as a share of the signal variance: it may lie anywhere among the
# candidates' values.
VARIANCE_SHARE: Final = 1.0


def with_threshold(
    preferences: Sequence[Preference], skips: Sequence[Skip], n: int
) -> tuple[Preference, ...]:
    """The answers and skips as comparisons among n candidates and the threshold, number n."""
    comparisons: list[Preference] = []
    for answer in preferences:
        comparisons.append(answer)
        comparisons.append(Preference(answer.winner, n, answer.origin, answer.query_index))
    for skip in skips:
        comparisons += [
            Preference(n, below, "answer", skip.query_index) for below in (skip.left, skip.right)
        ]
    return tuple(comparisons)


def sharpness(counted: Tally, n: int, noise: float) -> FloatArray:
    """1 for a comparison of two candidates, 1 / noise for one with the threshold, number n; (m,).

    noise: of a comparison with the threshold, as a share of that of two candidates.
    """
    threshold = counted.seen == n  # (p,)
    return np.where(threshold[counted.winner] | threshold[counted.loser], 1.0 / noise, 1.0)


# Priors are kept by `prior_over` and are the same object from step to step; so are these.
@lru_cache(maxsize=KEPT_PRIORS)
def prior_with_threshold(prior: Prior, signal_variance: float) -> Prior:
    """The prior over all candidates and, behind them, the threshold; (n + 1)."""
    variance = VARIANCE_SHARE * signal_variance
    return Prior(
        prior.length_scale,
        bordered(prior.covariance, variance),
        bordered(prior.root, float(np.sqrt(variance))),
    )


def bordered(matrix: FloatArray, corner: float) -> FloatArray:
    """One row and column of zeros more, with `corner` where they meet; (n + 1, n + 1)."""
    n = len(matrix)
    out = np.zeros((n + 1, n + 1))
    out[:n, :n] = matrix
    out[n, n] = corner
    return out
