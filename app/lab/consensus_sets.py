"""Sets of simulated people whose answers to the same random pairs are judged by several methods.

A set is a function over a grid drawn for its seed, which is the population's taste, and people with
tastes around it. All is a pure function of (case, seed). A person's pairs, answers and own taste
depend on the seed and on the person's number alone: an honest person says the same in every case of
a set that has the same share, and their first answers are the same where there are more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pbbo.people_answers import PersonAnswer

from .several_people import (
    NOISE_OCTAVES,
    Kind,
    PersonTraits,
    drawn_traits,
    evaluator_of,
    kinds_of,
    own_taste,
    smooth_function,
    valued,
)

FloatArray = NDArray[np.float64]
#: What `PreferenceOptimizer.replay` takes.
Entry = tuple[int, int, str, str | None, str]

#: Candidates are a square grid with so many steps a side.
SIDE: Final = 11
#: Length scales of populations' tastes are drawn from this range.
SHORTEST, LONGEST = 0.15, 0.5
#: Steepness of choices per deviation of g: the paper's eta times the deviation of its scores.
STEEPNESS: Final = 0.08 * 23.4
PEOPLE: Final = 6

#: Streams of a set's random numbers.
WORLD, TASTE, TRAITS, ANSWERS = range(4)


@dataclass(frozen=True)
class Case:
    """Who answers. own_share: r.  each: answers of a person.  unreliable: the last people's kinds.
    octaves: how far the noises of honest people lie around the usual one.  people: how many."""

    own_share: float
    each: int
    unreliable: tuple[Kind, ...] = ()
    octaves: float = NOISE_OCTAVES
    people: int = PEOPLE


ALL_THREE: Final[tuple[Kind, ...]] = ("spammer", "one-sided", "at-chance")

#: "r=0" has equal noises, so that one person of the same noise can stand beside it.
CASES: Final[dict[str, Case]] = {
    "r=0": Case(0.0, 10, octaves=0.0),
    "r=0.25": Case(0.25, 10),
    "r=0.5": Case(0.5, 10),
    "r=0.7": Case(0.7, 10),
    "spammer": Case(0.0, 30, ("spammer",)),
    "one-sided": Case(0.0, 30, ("one-sided",)),
    "at-chance": Case(0.0, 30, ("at-chance",)),
    "all three": Case(0.0, 30, ALL_THREE),
}


@dataclass(frozen=True, eq=False)
class Person:
    """One of a set. values: (n,), of the candidates.  answers: in the order in which they came."""

    name: str
    traits: PersonTraits
    values: FloatArray
    answers: tuple[PersonAnswer, ...]


@dataclass(frozen=True, eq=False)
class PeopleSet:
    """candidates: (n, 2).  f: (n,), the population's taste."""

    candidates: FloatArray
    f: FloatArray
    people: tuple[Person, ...]

    @property
    def honest(self) -> tuple[Person, ...]:
        return tuple(one for one in self.people if one.traits.kind == "honest")

    def history(self, people: tuple[Person, ...] | None = None) -> list[PersonAnswer]:
        """The answers of these people, by default everybody's, who answered in turn."""
        asked = [one.answers for one in (self.people if people is None else people)]
        return [answer for turn in zip(*asked, strict=True) for answer in turn]

    def consensus_regret(self, candidate: int) -> float:
        """How much worse a candidate is than the population's best, as a share of f's range."""
        return regret(self.f, candidate)


def regret(values: FloatArray, candidate: int) -> float:
    """max - value of a candidate, as a share of the range."""
    return float((values.max() - values[candidate]) / np.ptp(values))


def grid() -> FloatArray:
    """The candidates; (SIDE^2, 2)."""
    axis = np.linspace(0.0, 1.0, SIDE)
    return np.array([(a, b) for a in axis for b in axis])


@cache
def population(seed: int) -> FloatArray:
    """The taste of a set's population; (n,), mean 0 and deviation 1."""
    rng = np.random.default_rng([seed, WORLD])
    length = float(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
    return smooth_function(grid(), rng, length)


@cache
def taste(seed: int, number: int) -> FloatArray:
    """What a person likes apart from what everybody does; (n,)."""
    return own_taste(grid(), np.random.default_rng([seed, TASTE, number]))


def drawn_set(case: Case, seed: int) -> PeopleSet:
    """The set of a seed."""
    candidates, f = grid(), population(seed)
    kinds = kinds_of(case.people, case.unreliable)
    people = tuple(
        person(case, seed, number, kind, valued(f, taste(seed, number), case.own_share))
        for number, kind in enumerate(kinds)
    )
    return PeopleSet(candidates, f, people)


def person(case: Case, seed: int, number: int, kind: Kind, values: FloatArray) -> Person:
    """A person and what they answer to random pairs."""
    traits = drawn_traits(kind, np.random.default_rng([seed, TRAITS, number]), case.octaves)
    rng = np.random.default_rng([seed, ANSWERS, number])
    name = f"p{number}"
    return Person(name, traits, values, answered(name, traits, values, case.each, rng))


def answered(
    name: str, traits: PersonTraits, values: FloatArray, count: int, rng: np.random.Generator
) -> tuple[PersonAnswer, ...]:
    """What a person with these values answers to so many random pairs."""
    evaluator = evaluator_of(traits, rng, 0.0, 1.0, STEEPNESS)
    answers = []
    # The reason of a skip; it says nothing of choices.
    for _ in range(count):
        left, right = (int(row) for row in rng.choice(len(values), 2, replace=False))
        response = evaluator.respond(float(values[left]), float(values[right]), may_skip=True)
        answers.append(PersonAnswer(name, left, right, response, "both_bad"))
    return tuple(answers)


def one_person(case: Case, seed: int) -> Person:
    """One honest person of the population's taste who gives as many answers as all together."""
    traits = drawn_traits("honest", np.random.default_rng([seed, TRAITS, case.people]), 0.0)
    rng = np.random.default_rng([seed, ANSWERS, case.people])
    f = population(seed)
    return Person("one", traits, f, answered("one", traits, f, case.each * case.people, rng))


def entry(answer: PersonAnswer) -> Entry:
    """An answer as the optimiser takes it; choices have no reason."""
    reason = answer.reason if answer.response == "skip" else None
    return answer.left, answer.right, answer.response, reason, answer.person
