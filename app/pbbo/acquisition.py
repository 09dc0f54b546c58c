"""Choosing the next two candidates (Section III-B).

Thompson sampling, twice: two functions are drawn from the posterior over all candidates, and the
argmax of each is taken. The paper leaves open what happens when both are the same candidate, or
when the pair is the one just shown. Here the second function is drawn again, up to a few times;
then the best other candidate of the last one is taken.
"""

from collections.abc import Callable, Set
from typing import Final

import numpy as np

from .candidates import FloatArray

# Draws for the second candidate; a posterior that leaves all of them on one candidate is so sure
# of it that its runner-up is the fair opponent.
SECOND_DRAWS: Final = 7

Draw = Callable[[np.random.Generator, int], FloatArray]


def random_pair(rng: np.random.Generator, n: int, last: Set[int]) -> tuple[int, int]:
    """Two different candidates, uniformly over the pairs other than the one just shown."""
    while True:
        first, second = (int(i) for i in rng.choice(n, size=2, replace=False))
        # With two candidates there is only one pair.
        if n == 2 or {first, second} != last:
            return first, second


def thompson_pair(rng: np.random.Generator, draw: Draw, n: int, last: Set[int]) -> tuple[int, int]:
    """The argmax of two sampled functions, different and not the pair just shown."""
    functions = draw(rng, 1 + SECOND_DRAWS)  # (n, 1 + SECOND_DRAWS)
    best = np.argmax(functions, axis=0)
    first = int(best[0])
    for second in best[1:]:
        if allowed(first, int(second), n, last):
            return first, int(second)
    for second in np.argsort(-functions[:, -1], kind="stable"):
        if allowed(first, int(second), n, last):
            return first, int(second)
    raise AssertionError("with two candidates or more there is always another one")


def allowed(first: int, second: int, n: int, last: Set[int]) -> bool:
    """Whether this pair may be shown after the pair `last`."""
    return first != second and (n == 2 or {first, second} != last)
