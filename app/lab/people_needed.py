"""How many people of how many answers are needed to find what people like best.

Sets of simulated people answer random pairs, as in `consensus_sets`. For each number of people and
of answers, their answers are judged by the model of several people, pooled as if one person had
given all, and by a model of each person's own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from .consensus_methods import alone, replayed
from .consensus_sets import Case, drawn_set, regret
from .consensus_tables import with_error

#: A mean so far below what is asked for, in standard errors, is enough.
ERRORS: Final = 1.0


@dataclass(frozen=True)
class Found:
    """Regret of the best candidate by each way, one value a set, as shares of f's range.

    own: the mean over the people of a set, each with a model of their own.
    """

    people: int
    answers: int
    shared: tuple[float, ...]
    pooled: tuple[float, ...]
    own: tuple[float, ...]

    @property
    def total(self) -> int:
        return self.people * self.answers


def judged(people: int, answers: int, own_share: float, seeds: Sequence[int]) -> Found:
    """What so many people of so many answers each find, on these sets."""
    shared, pooled, own = [], [], []
    for seed in seeds:
        drawn = drawn_set(Case(own_share, answers, people=people), seed)
        history = drawn.history()
        shared.append(drawn.consensus_regret(replayed(drawn, history).best()))
        pooled.append(drawn.consensus_regret(alone(drawn, history).best()))
        bests = [alone(drawn, one.answers).best() for one in drawn.people]
        own.append(float(np.mean([regret(drawn.f, best) for best in bests])))
    return Found(people, answers, tuple(shared), tuple(pooled), tuple(own))


def sweep(
    people: Sequence[int], answers: Sequence[int], own_share: float, seeds: Sequence[int]
) -> Iterator[Found]:
    """Every number of people with every number of answers, fewest answers in all first."""
    sizes = sorted(
        {(count, each) for count in people for each in answers},
        key=lambda size: (size[0] * size[1], size),
    )
    for count, each in sizes:
        yield judged(count, each, own_share, seeds)


def enough(regrets: Sequence[float], within: float) -> bool:
    """Whether their mean, with its standard error, lies within this share of the range."""
    error = float(np.std(regrets, ddof=1)) / np.sqrt(len(regrets)) if len(regrets) > 1 else 0.0
    return float(np.mean(regrets)) + ERRORS * error <= within


def in_words(found: Sequence[Found], within: float) -> list[str]:
    """What is needed, a sentence for each way."""
    said = []
    for way, name in (
        ("shared", "With a shared model"),
        ("pooled", "Pooled as one person"),
        ("own", "With a model each"),
    ):
        first = next((one for one in found if enough(getattr(one, way), within)), None)
        if first is None:
            said.append(f"{name}: none of these is enough.")
        else:
            said.append(f"{name}: {first.people} people of {first.answers} answers are enough.")
    return said


def power_job(_: object, request: Mapping[str, Any], report: Callable[[int, int], None]) -> str:
    """The work of a job: the sweep that `request` asks for; its table and sentences as JSON."""
    sizes = len(set(request["people"])) * len(set(request["answers"]))
    seeds = range(request["seed"], request["seed"] + request["sets"])
    found: list[Found] = []
    report(0, sizes)
    for one in sweep(request["people"], request["answers"], request["own_share"], seeds):
        found.append(one)
        report(len(found), sizes)
    lines = [
        [one.people, one.answers, *map(with_error, (one.shared, one.pooled, one.own))]
        for one in found
    ]
    return json.dumps({"lines": lines, "says": in_words(found, request["within"])})
