"""One trial of a variant, or of a peer: what its acquired candidate is worth after so many queries.

A trial is a pure function of (variant, problem, evaluator, seed). All variants meet the same
evaluator's random stream under a seed, so that differences between them can be taken seed by seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.pbbo import PreferenceOptimizer, allows_skip

from .answering import EVALUATORS
from .evaluators import Discerning
from .peers import PEERS
from .problems import PROBLEMS, Problem
from .variant_definitions import VARIANTS, Variant

#: Regret is taken after so many queries.
LOOKS: Final = (10, 15, 20, 30)
#: A peer's first queries are random pairs.
PEER_RANDOM: Final = 5

#: The method that learns from ties.
TIES_METHOD: Final = "pbpo-threshold"

#: Streams of a trial's evaluator, and of a peer's random pairs.
ANSWERS: Final = 1
PAIRS: Final = 2


@dataclass(frozen=True)
class Call:
    """A trial to run. variant: a name of `VARIANTS` or of `PEERS`."""

    variant: str
    problem: str
    evaluator: str
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What a trial came to. regrets: after each of `LOOKS` that the trial reached."""

    call: Call
    regrets: tuple[float, ...]


def run_call(call: Call, queries: int = LOOKS[-1]) -> Outcome:
    """Run one trial."""
    problem = PROBLEMS[call.problem]()
    if call.variant in PEERS:
        regrets = peer_trial(call.variant, problem, call.evaluator, call.seed, queries)
    else:
        regrets = trial(VARIANTS[call.variant], problem, call.evaluator, call.seed, queries)
    return Outcome(call, tuple(regrets))


def trial(
    variant: Variant, problem: Problem, evaluator_name: str, seed: int, queries: int
) -> list[float]:
    """Regret of a variant after each of `LOOKS`."""
    optimizer = PreferenceOptimizer(
        problem.candidates, variant.method, seed, variant.settings_on(problem.name)
    )
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = EVALUATORS[evaluator_name](problem, rng)
    may_skip = variant.may_skip and allows_skip(variant.method)
    regrets = []
    for done in range(1, queries + 1):
        query = optimizer.ask()
        left, right = shown(problem, query.left, query.right, rng)
        response = evaluator.respond(left, right, may_skip=may_skip)
        reason = evaluator.reason if isinstance(evaluator, Discerning) else None
        if reason == "cannot_tell" and variant.ties == "forced":
            # No such button: one of the two is pressed all the same, as likely either.
            response, reason = ("left", "right")[int(rng.integers(2))], None
        told = reason if variant.ties == "learned" and variant.method == TIES_METHOD else None
        optimizer.tell(query, response, reason=told)
        if done in LOOKS:
            regrets.append(problem.regret(optimizer.best()))
    return regrets


def peer_trial(
    name: str, problem: Problem, evaluator_name: str, seed: int, queries: int
) -> list[float]:
    """Regret of a peer after each of `LOOKS`. Peers know no skip: evaluators never skip here."""
    # Scaled to the unit cube, as ours scales them and as the peers' priors expect.
    low, high = problem.candidates.min(axis=0), problem.candidates.max(axis=0)
    peer = PEERS[name]((problem.candidates - low) / (high - low), seed)
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = EVALUATORS[evaluator_name](problem, rng)
    random = np.random.default_rng([seed, PAIRS])
    pairs: list[tuple[int, int]] = []
    regrets = []
    coming: tuple[int, int] | None = None
    for done in range(1, queries + 1):
        if coming is None or done <= PEER_RANDOM:
            a, b = (int(i) for i in random.choice(len(problem.candidates), 2, replace=False))
        else:
            a, b = coming
        if random.integers(2):
            a, b = b, a
        left, right = shown(problem, a, b, rng)
        response = evaluator.respond(left, right, may_skip=False)
        pairs.append((a, b) if response == "left" else (b, a))
        if done >= PEER_RANDOM:
            coming = peer.step(pairs)
        if done in LOOKS:
            regrets.append(problem.regret(peer.best()))
    return regrets


def shown(problem: Problem, left: int, right: int, rng: np.random.Generator) -> tuple[float, float]:
    """g of the run shown on each side: one of the candidate's, at random."""
    runs = rng.integers(problem.scores.shape[1], size=2)
    return float(problem.scores[left, runs[0]]), float(problem.scores[right, runs[1]])


def calls(
    variants: Sequence[str],
    problems: Sequence[str],
    evaluators: Sequence[str],
    seeds: Sequence[int],
) -> list[Call]:
    """Every trial of these; all variants of a seed together, so that a stopped run is balanced."""
    return [
        Call(variant, problem, evaluator, seed)
        for evaluator in evaluators
        for problem in problems
        for seed in seeds
        for variant in variants
    ]
