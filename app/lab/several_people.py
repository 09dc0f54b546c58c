"""Simulated people with a taste of their own around a population's, some of whom are not reliable.

A person's value of a candidate is sqrt(1 - r) times the population's and sqrt(r) times a smooth
random function of their own, both with the same spread: r is the share of the variance of taste
that is people's own. A person answers from their values like the paper's uncertain evaluator, with
a noise and a threshold of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .evaluators import Evaluator, Response, Uncertain

FloatArray = NDArray[np.float64]

#: honest: as the uncertain evaluator.  spammer: left, right or skip, each as likely.  one-sided:
#: always left.  at-chance: skips as an honest person, and chooses by a coin.
Kind = Literal["honest", "spammer", "one-sided", "at-chance"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)

#: Noises of honest people lie within this many octaves of the usual one.
NOISE_OCTAVES: Final = 0.5
#: Their thresholds lie within this many deviations of the mean of g.
LEVELS: Final = 1.0
#: Length scale of a taste of one's own, as a share of each parameter's range.
TASTE_LENGTH: Final = 0.3
#: Added to the variance of a drawn function, so that its covariance factorises.
JITTER: Final = 1e-8


class SeveralPeopleError(ValueError):
    """People who cannot be simulated."""


@dataclass(frozen=True)
class PersonTraits:
    """What tells one simulated person from another.

    level: finds a run bad whose value lies below the mean plus this many deviations of g.
    noise: as a multiple of the uncertain evaluator's.
    """

    kind: Kind
    level: float
    noise: float


@dataclass(frozen=True)
class Spammer:
    """Presses any of the buttons."""

    rng: np.random.Generator

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        buttons: tuple[Response, ...] = ("left", "right", "skip") if may_skip else ("left", "right")
        return buttons[int(self.rng.integers(len(buttons)))]


@dataclass(frozen=True)
class AlwaysLeft:
    """Presses the left button."""

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        return "left"


def drawn_traits(
    kind: Kind, rng: np.random.Generator, octaves: float = NOISE_OCTAVES
) -> PersonTraits:
    """A person. octaves: how far noises lie around the usual one."""
    level, octave = rng.uniform(-1.0, 1.0, size=2)
    return PersonTraits(kind, LEVELS * float(level), 2.0 ** float(octaves * octave))


def evaluator_of(
    traits: PersonTraits, rng: np.random.Generator, mean: float, deviation: float, eta: float
) -> Evaluator:
    """Who answers. mean, deviation: of g.  eta: of the uncertain evaluator, per unit of g."""
    below = mean + traits.level * deviation
    match traits.kind:
        case "honest":
            return Uncertain(rng, below, eta / traits.noise)
        case "spammer":
            return Spammer(rng)
        case "one-sided":
            return AlwaysLeft()
        case "at-chance":
            return Uncertain(rng, below, 0.0)


def unreliable_kinds(spammers: int, one_sided: int, at_chance: int) -> tuple[Kind, ...]:
    """So many people of each kind that is not reliable."""
    counts: tuple[tuple[Kind, int], ...] = (
        ("spammer", spammers),
        ("one-sided", one_sided),
        ("at-chance", at_chance),
    )
    return tuple(kind for kind, count in counts for _ in range(count))


def kinds_of(people: int, unreliable: Sequence[Kind]) -> tuple[Kind, ...]:
    """Everybody's kind: honest people first. Raises SeveralPeopleError without an honest one."""
    if len(unreliable) >= people:
        raise SeveralPeopleError(
            f"people: expected more than the {len(unreliable)} who are not reliable, got {people}"
        )
    honest: Kind = "honest"
    return (*[honest] * (people - len(unreliable)), *unreliable)


def smooth_function(points: FloatArray, rng: np.random.Generator, length: float) -> FloatArray:
    """A draw from a Gaussian process with a Matern 5/2 kernel, at points (n, d) of the unit cube;
    its mean over them is 0, and its deviation 1; (n,). One point has 0."""
    away = np.sqrt(((points[:, None] - points[None]) ** 2).sum(axis=2)) * np.sqrt(5.0) / length
    covariance = (1.0 + away + away**2 / 3.0) * np.exp(-away)
    covariance[np.diag_indices(len(points))] += JITTER
    drawn = np.linalg.cholesky(covariance) @ rng.standard_normal(len(points))
    return standardised(drawn)


def standardised(values: FloatArray) -> FloatArray:
    """The values with mean 0 and deviation 1; all 0 where they are alike."""
    spread = float(values.std())
    away = values - values.mean()
    return np.asarray(away / spread if spread > 0.0 else np.zeros_like(away))


def in_unit_cube(points: FloatArray) -> FloatArray:
    """Points (n, d) with each parameter's range scaled to [0, 1]."""
    low, span = points.min(axis=0), np.ptp(points, axis=0)
    return np.asarray((points - low) / np.where(span > 0.0, span, 1.0))


def own_taste(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A taste of one's own over candidates (n, d), in deviations of g; (n,)."""
    return smooth_function(in_unit_cube(points), rng, TASTE_LENGTH)


def valued(population: FloatArray, own: FloatArray, own_share: float) -> FloatArray:
    """A person's values, in deviations of g around its mean; the shape of both."""
    if not 0.0 <= own_share <= 1.0:
        raise SeveralPeopleError(f"own share: expected a share from 0 to 1, got {own_share!r}")
    return np.asarray(np.sqrt(1.0 - own_share) * population + np.sqrt(own_share) * own)
