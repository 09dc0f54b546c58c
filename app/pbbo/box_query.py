"""A query of two points of a box."""

from dataclasses import dataclass

import numpy as np

from .candidates import FloatArray
from .preferences import TrialType


@dataclass(frozen=True, eq=False)
class BoxQuery:
    """Two points to compare; the rest as in `Query`. left, right: (d,), in the box's units."""

    index: int
    left: FloatArray
    right: FloatArray
    trial_type: TrialType
    acquisition: str
    seed: int

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, BoxQuery)
            and (self.index, self.seed) == (other.index, other.seed)
            and np.array_equal(self.left, other.left)
            and np.array_equal(self.right, other.right)
        )

    def __hash__(self) -> int:
        return hash((self.index, self.seed, self.left.tobytes(), self.right.tobytes()))
