"""Comparisons of candidates, counted, as probit answers about independent variables.

The same comparison given twice is one answer with a count of two. The latent values at the
candidates that were compared are whitened, so that the variational fit sees independent standard
normal variables, no more of them than the comparisons span.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from app.pbbo.candidates import FloatArray, IndexArray
from app.pbbo.errors import FitError
from app.pbbo.preferences import Preference
from app.pbbo.variational import Answers


@dataclass(frozen=True, eq=False)
class Tally:
    """Different answers and how often each was given.

    seen: (p,), the candidates in them, ascending.  winner, loser: (m,), places in `seen`.
    counts: (m,).
    """

    seen: IndexArray
    winner: IndexArray
    loser: IndexArray
    counts: FloatArray


def tally(preferences: Sequence[Preference]) -> Tally:
    """Sorted, so that the order of the answers does not reach the arithmetic."""
    pairs = np.array([(p.winner, p.loser) for p in preferences], dtype=np.intp)
    different, counts = np.unique(pairs, axis=0, return_counts=True)
    seen, place = np.unique(different, return_inverse=True)
    place = place.reshape(different.shape)
    return Tally(seen, place[:, 0], place[:, 1], counts.astype(np.float64))


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
    if len(compared) < len(root):
        # Fewer pairs compared than candidates in them: only what the pairs span matters.
        basis, _ = np.linalg.qr((root[compared[:, 0]] - root[compared[:, 1]]).T)
        features = features @ basis  # (m, r)
        whiten = basis.T @ whiten  # (r, p)
    features = features * np.reshape(sharpness, (-1, 1))
    answers = Answers(features, tally.counts, float(np.sqrt(2.0)) * epsilon)
    return Whitened(tally.seen, whiten, answers)
