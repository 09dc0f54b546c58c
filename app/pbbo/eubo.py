"""Choosing the two candidates of which the better one is expected to be best.

The expected utility of the best option, E[max(f_a, f_b)] (Lin et al. 2022): a pair is worth as much
as the better of its two, so both should be good, and so different in what is known of them that one
may be much the better. With the mixture of several posteriors it is the weighted mean of theirs.

The deviation of f_a - f_b may be multiplied by a boldness: above 1, a pair is chosen for what it
could turn out to be. Where a machine may refuse to run a candidate, the utility is the expectation
over what it runs: of one alone that one's, of none the lowest listed.
"""

from collections.abc import Collection, Set
from typing import Final

import numpy as np
from scipy.special import ndtr

from .acquisition import allowed
from .candidates import FloatArray, IndexArray
from .model import Posterior
from .model_averaging import Average

# All pairs among this many candidates with the largest upper bounds are looked at. The pair chosen
# of 231 candidates is the same in all but a few steps, at a tenth of the cost.
SHORTLIST: Final = 80
# Where one of a pair has to be known, so many of the known ones are listed besides.
KNOWN_LISTED: Final = 20
# The bound's height: mean + BOUND x boldness x standard deviation.
BOUND: Final = 2.0
# A part of the mixture that weighs less changes no choice worth its time.
LEAST_WEIGHT: Final = 0.01

SQRT_2PI: Final = float(np.sqrt(2.0 * np.pi))


def eubo_pair(
    belief: Average,
    boldness: float,
    last: Set[int],
    known: IndexArray | None = None,
    barred: IndexArray | None = None,
    pending: Collection[Set[int]] = (),
    safe: FloatArray | None = None,
) -> tuple[int, int]:
    """The pair with the largest expected utility of its better candidate, but not `last` again.

    known: if given, one of the pair is among these rows.  barred: rows that no pair may have.
    pending: further pairs that are not to be shown again.  safe: (n,), the probability that each
    candidate can be run; None: all can.
    """
    listed = shortlist(belief, boldness, known, barred, safe)
    row, column = np.triu_indices(len(listed), 1)
    if known is not None:
        with_known = np.isin(listed, known)
        pairs = with_known[row] | with_known[column]
        row, column = row[pairs], column[pairs]
    utility = np.zeros(len(row))
    for part, weight in zip(belief.parts, belief.weights, strict=True):
        if weight >= LEAST_WEIGHT:
            best = expected_best(part, listed, boldness)
            if safe is not None:
                best = _over_what_is_run(best, part.mean[listed], safe[listed])
            utility += weight * best[row, column]
    n = len(belief.mean)
    for pair in np.argsort(-utility, kind="stable")[: 2 + len(pending)]:
        first, second = int(listed[row[pair]]), int(listed[column[pair]])
        if allowed(first, second, n, last) and {first, second} not in pending:
            return first, second
    # All but the last pair is barred: it is shown again rather than nothing.
    if len(row):
        return int(listed[row[0]]), int(listed[column[0]])
    raise AssertionError("expected two candidates at least that may be shown")


def shortlist(
    belief: Average,
    boldness: float,
    known: IndexArray | None = None,
    barred: IndexArray | None = None,
    safe: FloatArray | None = None,
) -> IndexArray:
    """The candidates that may be the better of a pair, ascending; the best by mean among them.

    known: those of these rows with the largest upper bounds are listed too.
    """
    bound = belief.mean + BOUND * boldness * belief.std
    mean = belief.mean
    if safe is not None:
        bound = mean.min() + safe * (bound - mean.min())
    if barred is not None and len(barred):
        bound, mean = bound.copy(), mean.copy()
        bound[barred] = mean[barred] = -np.inf
    hopeful = np.argsort(-bound, kind="stable")[:SHORTLIST]
    listed = np.append(hopeful, np.argmax(mean))
    if known is not None:
        listed = np.append(listed, known[np.argsort(-bound[known], kind="stable")[:KNOWN_LISTED]])
    listed = np.unique(listed)
    return listed[np.isfinite(bound[listed])]


def _over_what_is_run(best: FloatArray, mean: FloatArray, safe: FloatArray) -> FloatArray:
    """Expected utility of pairs of which each may be refused; (k, k).

    best: E[max(f_a, f_b)].  mean, safe: of each candidate, (k,).
    """
    alone = np.outer(safe * mean, 1.0 - safe)
    neither = np.outer(1.0 - safe, 1.0 - safe) * mean.min()
    return np.asarray(np.outer(safe, safe) * best + alone + alone.T + neither)


def expected_best(part: Posterior, listed: IndexArray, boldness: float) -> FloatArray:
    """E[max(f_a, f_b)] over all pairs of the listed candidates; (k, k)."""
    mean = part.mean[listed]
    covariance = part.covariance(listed)
    own = np.diagonal(covariance)
    variance = own[:, None] + own[None, :] - 2.0 * covariance
    # The deviation of a candidate from itself is 0; the floor keeps the quotient finite.
    floor = np.finfo(np.float64).tiny
    deviation = boldness * np.sqrt(np.maximum(variance, floor))
    gap = mean[:, None] - mean[None, :]
    z = gap / deviation
    density = np.exp(-0.5 * z * z) / SQRT_2PI
    return np.asarray(mean[None, :] + gap * ndtr(z) + deviation * density)
