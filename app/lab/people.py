"""Five simulated evaluators who stand in for the people of the paper's section VII.

They answer from g like the uncertain evaluator, and differ from each other as the people of
appendix C do: one hardly ever skips, another very often. What tells them apart was laid down
before any result was seen: thresholds in even steps around the mean of g, consistencies a factor
of sqrt(2) apart around the paper's eta, and no order between the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from .evaluators import ETA, Response

#: What the skip button is for: "undesirable" in PBPO, "equal" in PBPO without synthesis.
SkipReason = Literal["undesirable", "equal"]


class TraitError(ValueError):
    """A trait that nobody can have."""


@dataclass(frozen=True)
class Traits:
    """What tells one simulated person from another.

    skip_level: finds a run bad whose g lies below the mean of g over W plus this many standard
        deviations of g over W.
    eta: consistency, the steepness of the choice per gram of g.
    equal_within: finds two runs equal whose g differ by less than this, in grams.
    """

    skip_level: float
    eta: float
    equal_within: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.skip_level):
            raise TraitError(f"skip_level: expected a finite number, got {self.skip_level!r}")
        for name, value in (("eta", self.eta), ("equal_within", self.equal_within)):
            if not (np.isfinite(value) and value > 0):
                raise TraitError(f"{name}: expected a finite number above 0, got {value!r}")


PEOPLE: Final[tuple[Traits, ...]] = (
    Traits(skip_level=-1.0, eta=ETA, equal_within=4.0),
    Traits(skip_level=-0.5, eta=2.0 * ETA, equal_within=8.0),
    Traits(skip_level=0.0, eta=ETA / 2.0, equal_within=2.0),
    Traits(skip_level=0.5, eta=2.0**0.5 * ETA, equal_within=6.0),
    Traits(skip_level=1.0, eta=ETA / 2.0**0.5, equal_within=10.0),
)


@dataclass(frozen=True)
class Person:
    """Answers as an evaluator with these traits would.

    mean, deviation: of g over the search space, which the person knows from the familiarisation.
    """

    traits: Traits
    skip_reason: SkipReason
    mean: float
    deviation: float
    rng: np.random.Generator

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        if may_skip and self._would_skip(left, right):
            return "skip"
        probability = 1 / (1 + np.exp(-self.traits.eta * (left - right)))
        return "left" if self.rng.random() < probability else "right"

    def _would_skip(self, left: float, right: float) -> bool:
        if self.skip_reason == "equal":
            return abs(left - right) < self.traits.equal_within
        return max(left, right) < self.mean + self.traits.skip_level * self.deviation
