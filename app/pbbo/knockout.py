"""The baseline of Appendix A: the last winner meets a random challenger.

Read with two corrections: the inner loop of Algorithm 1 runs over i = 0, 1, and Q is a union. A
challenger is never the winner itself, and never the one just shown beside it unless there are only
two candidates.
"""

from collections.abc import Set

import numpy as np


def challenger(rng: np.random.Generator, n: int, winner: int, last: Set[int]) -> int:
    """A random opponent for `winner`, uniformly over those that make a new pair."""
    while True:
        drawn = int(rng.integers(n))
        if drawn != winner and (n == 2 or {winner, drawn} != last):
            return drawn
