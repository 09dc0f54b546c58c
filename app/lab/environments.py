"""A world as experiments see it: the search space, and g of every recorded run (paper section V-C).

Experiments need scores, not videos. A world is a small value that travels to any process.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.crane import library
from app.crane.environments import FloatArray, candidates
from app.crane.evaluation import objective


class WorldError(ValueError):
    """Candidates and scores that do not belong together."""


@dataclass(frozen=True, eq=False)
class World:
    """One environment.

    candidates: (n, 2), w0 and w1 in seconds. scores: (n, runs), g of each recorded run, in grams.
    """

    name: str
    candidates: FloatArray
    scores: FloatArray

    def __post_init__(self) -> None:
        if self.candidates.ndim != 2 or self.candidates.shape[1] != 2:
            raise WorldError(
                f"{self.name}: expected candidates (n, 2), got shape {self.candidates.shape}"
            )
        if self.scores.ndim != 2 or len(self.scores) != len(self.candidates):
            raise WorldError(
                f"{self.name}: expected scores ({len(self.candidates)}, runs), "
                f"got shape {self.scores.shape}"
            )

    @cached_property
    def f(self) -> FloatArray:
        """f (Eq. 14) of every candidate, (n,)."""
        return objective(self.scores)

    @cached_property
    def best(self) -> int:
        """w*: the candidate with the largest f."""
        return int(np.argmax(self.f))

    @cached_property
    def mean(self) -> float:
        """Mean of g over the search space."""
        return float(self.scores.mean())

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of g over the search space."""
        return float(self.scores.std())

    @property
    def runs(self) -> int:
        """Recorded runs of each candidate."""
        return int(self.scores.shape[1])

    def digest(self) -> str:
        """The same for the same recordings, so that results of others are never mixed in."""
        parts = self.candidates.tobytes() + self.scores.tobytes()
        return hashlib.sha256(parts).hexdigest()[:16]


def recorded(name: str) -> World:
    """The recorded runs of the environment of this name ("env1", "env2")."""
    return World(name, candidates(), library.scores(name))
