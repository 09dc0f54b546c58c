"""Simulated people with tastes of their own, who answer from the scores of a study's recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .evaluators import Evaluator
from .several_people import (
    Kind,
    drawn_traits,
    evaluator_of,
    kinds_of,
    own_taste,
    standardised,
    valued,
)


@dataclass(frozen=True)
class ScoredRecording:
    """A recording of a candidate. key: a number of its own.  point: the candidate's parameters."""

    key: int
    environment: str
    candidate: int
    point: tuple[float, ...]
    score: float


@dataclass(frozen=True)
class SimulatedPeople:
    """How many people take part. own_share: r.  unreliable: the kinds of the last of them.

    Raises SeveralPeopleError for people who cannot be.
    """

    people: int
    own_share: float = 0.0
    unreliable: tuple[Kind, ...] = ()

    def __post_init__(self) -> None:
        kinds_of(self.people, self.unreliable)
        valued(np.zeros(1), np.zeros(1), self.own_share)


@dataclass(frozen=True)
class SessionPerson:
    """One person. scores: what each recording is worth to them, by its key.  settings: what tells
    them from others."""

    evaluator: Evaluator
    scores: Mapping[int, float]
    settings: Mapping[str, Any]


def session_person(
    people: SimulatedPeople,
    index: int,
    recordings: Sequence[ScoredRecording],
    seed: int,
    steepness: float,
) -> SessionPerson:
    """The person of a session, always the same for the same arguments.

    steepness: of choices, per deviation of the scores.
    """
    kind = kinds_of(people.people, people.unreliable)[index]
    rng = np.random.default_rng([seed, index])
    traits = drawn_traits(kind, rng)
    values = np.array([one.score for one in recordings])
    mean, spread = float(values.mean()), float(values.std())
    mine = mean + spread * valued(standardised(values), tastes(recordings, rng), people.own_share)
    return SessionPerson(
        evaluator_of(traits, rng, mean, spread, steepness / max(spread, 1e-12)),
        dict(zip([one.key for one in recordings], mine.tolist(), strict=True)),
        {
            "person": kind,
            "own_share": people.own_share,
            "noise": traits.noise,
            "skip_below": mean + traits.level * spread,
        },
    )


def tastes(recordings: Sequence[ScoredRecording], rng: np.random.Generator) -> np.ndarray[Any, Any]:
    """A person's own taste of each recording's candidate, in deviations; (recordings,).

    All recordings of a candidate have the same; environments have each a taste of their own.
    """
    drawn: dict[tuple[str, int], float] = {}
    for environment in sorted({one.environment for one in recordings}):
        points = {one.candidate: one.point for one in recordings if one.environment == environment}
        candidates = sorted(points)
        own = own_taste(np.array([points[candidate] for candidate in candidates]), rng)
        drawn |= {(environment, c): float(v) for c, v in zip(candidates, own, strict=True)}
    return np.array([drawn[one.environment, one.candidate] for one in recordings])
