"""The finite search space: a validated (n, d) array of parameter vectors.

Each parameter is scaled by its range over the candidates to [0, 1], so that one length scale can
serve parameters of different units. For the waste crane, whose two times both run from 0 s to 1 s,
this changes nothing.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .errors import CandidatesError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Candidates:
    """points: (n, d), as the kernel sees them; never written to."""

    points: FloatArray

    @classmethod
    def from_array(cls, array: Any, *, scale: bool) -> Self:
        """Validate the candidates and, if asked to, scale them to the unit cube."""
        points = checked(array)
        if scale:
            low = points.min(axis=0)
            span = points.max(axis=0) - low
            # A parameter that never varies carries no information; leave it at 0.
            points = (points - low) / np.where(span > 0.0, span, 1.0)
        points.setflags(write=False)
        return cls(points)

    def __len__(self) -> int:
        return len(self.points)


def checked(array: Any) -> FloatArray:
    """A float copy of a finite 2-D array of at least two different rows, or `CandidatesError`."""
    try:
        points = np.array(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CandidatesError(
            f"candidates: expected a 2-D array of numbers, got {type(array).__name__} ({error})"
        ) from error
    if points.ndim != 2:
        raise CandidatesError(
            f"candidates: expected a 2-D array (n, d), got {points.ndim}-D of shape {points.shape}"
        )
    if len(points) < 2 or points.shape[1] < 1:
        raise CandidatesError(
            "candidates: expected at least 2 rows and 1 column, "
            f"got {points.shape[0]} rows and {points.shape[1]} columns"
        )
    if not np.isfinite(points).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(points))[0])
        raise CandidatesError(
            f"candidates: expected finite numbers, got {points[row, column]} "
            f"in row {row}, column {column}"
        )
    refuse_duplicates(points)
    return points


def refuse_duplicates(points: FloatArray) -> None:
    """Two equal rows could be compared with each other, which no answer could decide."""
    # Adding 0.0 turns -0.0 into 0.0, which is the same candidate.
    _, first, inverse = np.unique(points + 0.0, axis=0, return_index=True, return_inverse=True)
    first_of_row = first[inverse.ravel()]
    again = np.flatnonzero(first_of_row != np.arange(len(points)))
    if len(again):
        row = int(again[0])
        raise CandidatesError(
            f"candidates: expected different rows, got rows {int(first_of_row[row])} and {row} "
            f"both {points[row].tolist()}"
        )
