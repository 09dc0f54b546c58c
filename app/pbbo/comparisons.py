"""Comparisons of candidates, counted, as probit answers about independent variables.

The same comparison given twice is one answer with a count of two. The latent values at the
candidates that were compared are whitened, so that the variational fit sees independent standard
normal variables, no more of them than the comparisons span.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from .candidates import FloatArray, IndexArray
from .errors import FitError
from .preferences import Preference
from .variational import Answers


class Comparison(NamedTuple):
    """A probit observation of f_winner - f_loser + margin * delta > 0.

    delta is the tie width, one latent value more; margin is 0 where it has no part in the
    comparison, -1 in a choice and 1 in each half of a tie (`threshold`).
    """

    winner: int
    loser: int
    margin: int = 0


@dataclass(frozen=True, eq=False)
class Tally:
    """Different comparisons and how often each was made.

    seen: (p,), the latent values in them, ascending; delta, the largest number, is the last one if
    any comparison has a margin.  winner, loser: (m,), places in `seen`.  margin: (m,), -1, 0 or 1.
    counts: (m,).
    """

    seen: IndexArray
    winner: IndexArray
    loser: IndexArray
    margin: FloatArray
    counts: FloatArray

    @property
    def has_margins(self) -> bool:
        """Whether delta has a part in any comparison."""
        return bool(self.margin.any())


def tally(preferences: Sequence[Preference]) -> Tally:
    """Answers counted; sorted, so that their order does not reach the arithmetic."""
    return counted([Comparison(p.winner, p.loser) for p in preferences])


def counted(comparisons: Sequence[Comparison], delta: int = -1) -> Tally:
    """Comparisons counted. delta: the number of the tie width, above every other number."""
    rows = np.array(comparisons, dtype=np.intp)  # (answers, 3)
    different, counts = np.unique(rows, axis=0, return_counts=True)
    seen, place = np.unique(different[:, :2], return_inverse=True)
    place = place.reshape(len(different), 2)
    margin = different[:, 2].astype(np.float64)
    if margin.any():
        seen = np.append(seen, delta)
    return Tally(seen, place[:, 0], place[:, 1], margin, counts.astype(np.float64))


@dataclass(frozen=True, eq=False)
class Whitened:
    """Preferences as probit answers about whitened variables z = whiten @ f[seen].

    seen: (p,), the candidates in them.  whiten: (r, p), r the smaller of p and the number of
    pairs compared.  answers: what the variational fit takes.
    """

    seen: IndexArray
    whiten: FloatArray
    answers: Answers


def whitened(
    tally: Tally, covariance: FloatArray, epsilon: float, sharpness: FloatArray | float = 1.0
) -> Whitened:
    """The answers in terms of independent variables; covariance: (p, p), prior, of those seen.

    sharpness: (m,), how many times smaller than epsilon the noise of an answer is.
    """
    root, info = lapack.dpotrf(covariance, lower=1, clean=1)
    if info != 0:
        raise FitError(f"model: the covariance of {len(covariance)} candidates does not factorise")
    whiten, _ = lapack.dtrtri(root, lower=1)  # (p, p)
    features = root[tally.winner] - root[tally.loser]  # (m, p)
    compared = np.unique(np.sort(np.column_stack([tally.winner, tally.loser]), axis=1), axis=0)
    spanning = root[compared[:, 0]] - root[compared[:, 1]]
    if tally.has_margins:
        features = features + tally.margin[:, None] * root[-1]
        spanning = np.vstack([spanning, root[-1]])
    if len(spanning) < len(root):
        # Fewer pairs compared than candidates in them: only what the pairs span matters.
        basis, _ = np.linalg.qr(spanning.T)
        features = features @ basis  # (m, r)
        whiten = basis.T @ whiten  # (r, p)
    features = features * np.reshape(sharpness, (-1, 1))
    answers = Answers(features, tally.counts, float(np.sqrt(2.0)) * epsilon)
    return Whitened(tally.seen, whiten, answers)
