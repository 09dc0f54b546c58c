"""The evaluators that variants are compared under, by name.

All answer from g of the two runs shown, as the paper's uncertain evaluator does; each differs from
it in one respect. The first is the one that a setting is chosen under, the others show whether what
was chosen holds for people who are more consistent or less, who slip, or who skip at another level.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from .evaluators import Discerning, Evaluator, Lapsing, LeftAtFirst, Uncertain
from .problems import Problem

#: Skip levels drawn for an evaluator lie within this many deviations of g around its mean.
DRAWN_LEVELS: Final = 1.0
#: How many queries an evaluator who does not look answers left.
LEFT_QUERIES: Final = 5
#: The just-noticeable difference of one who also skips where they cannot tell, in deviations of g.
NOTICEABLE: Final = 0.4


def uncertain(
    problem: Problem, rng: np.random.Generator, *, eta: float = 1.0, level: float | None = 0.0
) -> Uncertain:
    """eta: a multiple of the paper's. level: skips when both runs lie below the mean of g plus this
    many deviations of g; None: never."""
    below = None if level is None else problem.mean + level * problem.deviation
    return Uncertain(rng, skip_below=below, eta=eta * problem.eta)


EVALUATORS: Final[dict[str, Callable[[Problem, np.random.Generator], Evaluator]]] = {
    "uncertain": uncertain,
    "half-eta": lambda problem, rng: uncertain(problem, rng, eta=0.5),
    "double-eta": lambda problem, rng: uncertain(problem, rng, eta=2.0),
    "lapse-5": lambda problem, rng: Lapsing(rng, uncertain(problem, rng), 0.05),
    "lapse-10": lambda problem, rng: Lapsing(rng, uncertain(problem, rng), 0.10),
    "skip-low": lambda problem, rng: uncertain(problem, rng, level=-1.0),
    "skip-high": lambda problem, rng: uncertain(problem, rng, level=1.0),
    "skip-drawn": lambda problem, rng: uncertain(
        problem, rng, level=float(rng.uniform(-DRAWN_LEVELS, DRAWN_LEVELS))
    ),
    "no-skip": lambda problem, rng: uncertain(problem, rng, level=None),
    "cannot-tell": lambda problem, rng: Discerning(
        uncertain(problem, rng), NOTICEABLE * problem.deviation
    ),
    "left-at-first": lambda problem, rng: LeftAtFirst(uncertain(problem, rng), LEFT_QUERIES),
}
