"""Where every random draw of the optimiser comes from.

A draw is a pure function of (seed, purpose, index): no generator is kept between calls, so that a
process that is killed and started again draws the same numbers, and so that two purposes never
share a stream.
"""

from enum import IntEnum
from typing import Final

import numpy as np

from .errors import SeedError

# SQLite and pandas keep integers in 64 signed bits; a larger seed could not be recorded.
LARGEST_SEED: Final = 2**63 - 1


class Purpose(IntEnum):
    """What a stream is for. The numbers are part of every recorded trial: never renumber."""

    RANDOM_PAIR = 1
    THOMPSON = 2
    SIDES = 3
    SYNTHESIS = 4
    UNINFORMED = 5
    KNOCKOUT = 6
    SCORE = 7
    COVERING = 8
    DESIGN = 9
    REFINING = 10
    SURENESS = 11


def checked_seed(seed: object) -> int:
    """The seed as a plain int, or `SeedError`."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)):
        raise SeedError(f"seed: expected a whole number, got {seed!r}")
    if not 0 <= int(seed) <= LARGEST_SEED:
        raise SeedError(f"seed: expected 0 to {LARGEST_SEED}, got {seed!r}")
    return int(seed)


def generator(seed: int, purpose: Purpose, index: int) -> np.random.Generator:
    """The generator for one purpose at one query index."""
    return np.random.default_rng([seed, int(purpose), index])
