"""What each method makes of the answers of a set of people.

shared: the model of several people.  pooled: one person's model, given everybody's answers.  own:
a model each.  one person: the same model of one person who gives all answers.  without: the
model of several people, given honest people's answers alone.  random effects, noisy BT: Bradley-
Terry models, which know no skips and no parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import Final

import numpy as np

from app.pbbo import PeopleSettings, PreferenceOptimizer
from app.pbbo.people_answers import PersonAnswer
from app.pbbo.people_summary import NOISY

from .consensus_sets import CASES, Case, PeopleSet, drawn_set, entry, one_person, regret
from .random_effects import Choice, abilities

METHOD: Final = "pbpo-threshold"
#: A person is named unreliable whose noise is `NOISY` or more with this probability, as on the
#: page of people.
LEAST_NOISY: Final = 0.7
#: The optional package's module, imported when it is asked for.
NOISY_BT: Final = "crowdkit.aggregation.pairwise.noisy_bt"


@dataclass(frozen=True)
class Row:
    """What a method made of a set. Regrets are shares of the range of values.

    consensus: the population's regret of the population's best.  these: the regret of the same on
    the mean of the honest people's values.  personal: the mean regret of honest people's bests on
    their own values.  honest_named, unreliable_named: how many of each kind are called unreliable.
    own_share: the mean of r.  None where the method does not say.
    """

    case: str
    seed: int
    method: str
    consensus: float
    these: float
    personal: float | None = None
    honest_named: int | None = None
    unreliable_named: int | None = None
    own_share: float | None = None


def shared_model(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """The model of several people."""
    optimizer = replayed(drawn, drawn.history())
    best = optimizer.best()
    model, settings = optimizer.people_model(), PeopleSettings()
    noisy = np.array(settings.noises) >= NOISY
    likely = dict(zip(model.names, model.noise_weights @ noisy, strict=True))
    honest = {one.name for one in drawn.honest}
    named = {who for who, chance in likely.items() if chance >= LEAST_NOISY}
    personal = [regret(one.values, optimizer.best(one.name)) for one in drawn.honest]
    return [
        Row(
            name,
            seed,
            "shared",
            *consensus(drawn, best),
            personal=float(np.mean(personal)),
            honest_named=len(named & honest),
            unreliable_named=len(named - honest),
            own_share=float(model.share_weights @ np.array(settings.own_shares)),
        )
    ]


def without_unreliable(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """The same model had those who are not reliable never answered."""
    case = CASES[name]
    if not case.unreliable:
        return []
    # The answers of honest people do not depend on who the others are.
    best = best_of_honest(case.own_share, case.each, case.octaves, len(drawn.honest), seed)
    return [Row(name, seed, "without", *consensus(drawn, best))]


@lru_cache(maxsize=8)
def best_of_honest(own_share: float, each: int, octaves: float, honest: int, seed: int) -> int:
    """The population's best after the first people's answers."""
    drawn = drawn_set(Case(own_share, each, octaves=octaves), seed)
    return replayed(drawn, drawn.history(drawn.people[:honest])).best()


def pooled_model(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """One person's model, given everybody's answers."""
    best = alone(drawn, drawn.history()).best()
    personal = float(np.mean([regret(one.values, best) for one in drawn.honest]))
    return [Row(name, seed, "pooled", *consensus(drawn, best), personal=personal)]


def own_models(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """A model for each person, where all are honest: the mean of what their bests are worth."""
    if CASES[name].unreliable:
        return []
    bests = [alone(drawn, one.answers).best() for one in drawn.people]
    means = np.mean([consensus(drawn, best) for best in bests], axis=0)
    personal = [regret(one.values, best) for one, best in zip(drawn.people, bests, strict=True)]
    return [
        Row(name, seed, "own", float(means[0]), float(means[1]), personal=float(np.mean(personal)))
    ]


def one_persons_model(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """One person of the usual noise who gives all answers; where noises and tastes are equal."""
    case = CASES[name]
    if case.octaves or case.own_share or case.unreliable:
        return []
    best = alone(drawn, one_person(case, seed).answers).best()
    return [Row(name, seed, "one person", *consensus(drawn, best))]


def bt_random_effects(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """Bradley-Terry with random effects."""
    found = choices(drawn)
    if not found:
        return []
    best = int(np.argmax(abilities(found, len(drawn.candidates))))
    return [Row(name, seed, "random effects", *consensus(drawn, best))]


def noisy_bradley_terry(name: str, seed: int, drawn: PeopleSet) -> list[Row]:
    """crowd-kit's Bradley-Terry with a skill and a bias of each person."""
    table = import_module("pandas").DataFrame(
        [
            (answer.person, answer.left, answer.right, chosen(answer))
            for answer in drawn.history()
            if answer.response != "skip"
        ],
        columns=["worker", "left", "right", "label"],
    )
    if table.empty:
        return []
    model = import_module(NOISY_BT).NoisyBradleyTerry(n_iter=100)
    with np.errstate(all="ignore"):
        # Its likelihood overflows far from the optimum.
        scores = model.fit_predict(table)
    return [Row(name, seed, "noisy BT", *consensus(drawn, int(scores.idxmax())))]


METHODS: Final[dict[str, Callable[[str, int, PeopleSet], list[Row]]]] = {
    "shared": shared_model,
    "pooled": pooled_model,
    "own": own_models,
    "one person": one_persons_model,
    "without": without_unreliable,
    "random effects": bt_random_effects,
    "noisy BT": noisy_bradley_terry,
}


def installed() -> list[str]:
    """The methods that can be run here: crowd-kit is optional."""
    there = find_spec(NOISY_BT.partition(".")[0]) is not None
    return [name for name in METHODS if there or name != "noisy BT"]


def judged(seed: int, cases: Sequence[str], methods: Sequence[str]) -> list[Row]:
    """What these methods make of a seed's set in each of these cases."""
    rows = []
    for name in cases:
        drawn = drawn_set(CASES[name], seed)
        for method in methods:
            rows += METHODS[method](name, seed, drawn)
    return rows


def consensus(drawn: PeopleSet, best: int) -> tuple[float, float]:
    """Regret of a candidate for the population, and for the honest people of the set."""
    these = np.mean([one.values for one in drawn.honest], axis=0)
    return regret(drawn.f, best), regret(these, best)


def replayed(drawn: PeopleSet, history: Sequence[PersonAnswer]) -> PreferenceOptimizer:
    """The model of several people after these answers."""
    entries = [entry(answer) for answer in history]
    return PreferenceOptimizer.replay(drawn.candidates, entries, method=METHOD)


def alone(drawn: PeopleSet, history: Sequence[PersonAnswer]) -> PreferenceOptimizer:
    """One person's model after these answers."""
    entries = [entry(answer)[:4] for answer in history]
    return PreferenceOptimizer.replay(drawn.candidates, entries, method=METHOD)


def chosen(answer: PersonAnswer) -> int:
    """The candidate that was chosen."""
    return answer.left if answer.response == "left" else answer.right


def choices(drawn: PeopleSet) -> list[Choice]:
    """Everybody's choices; skips are none."""
    numbers = {one.name: number for number, one in enumerate(drawn.people)}
    found = []
    for answer in drawn.history():
        if answer.response != "skip":
            winner = chosen(answer)
            loser = answer.right if winner == answer.left else answer.left
            found.append((numbers[answer.person], winner, loser))
    return found
