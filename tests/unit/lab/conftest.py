"""Small worlds whose best candidate is known, and results whose outcome was chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import pytest

from app.crane.environments import candidates
from app.lab.environments import World
from app.lab.experiments import ENVIRONMENTS, FIGURES, Task, plan
from app.lab.results import Results, Trial
from app.lab.steps import Step

RUNS = 5

#: How many candidates are better than the one a method has acquired, in a trial.
Rank = Callable[[Task], int]


def peaked_world(name: str, spread: float = 0.0) -> World:
    """A world on the real search space whose f falls with the distance from (0.5, 0.25)."""
    space = candidates()
    away = np.hypot(space[:, 0] - 0.5, space[:, 1] - 0.25)
    noise = np.linspace(-spread, spread, RUNS)
    return World(name, space, -40.0 - 100.0 * away[:, None] + noise)


@pytest.fixture(scope="session")
def world() -> World:
    return peaked_world("env1", spread=2.0)


@pytest.fixture(scope="session")
def worlds() -> Mapping[str, World]:
    return {name: peaked_world(name, spread=2.0) for name in ENVIRONMENTS}


@pytest.fixture(scope="session")
def make_results(worlds: Mapping[str, World]) -> Callable[[Rank], Results]:
    """Results in which a trial acquires, at every step, the candidate of the rank it is told."""

    @cache
    def make(rank: Rank) -> Results:
        trials = [made_up(task, worlds[task.environment], rank(task)) for task in tasks()]
        return Results(trials, worlds, seed=0)

    return make


def tasks() -> list[Task]:
    return plan(FIGURES, 0, trials=6)


def made_up(task: Task, world: World, rank: int) -> Trial:
    order = np.argsort(-world.f, kind="stable")
    acquired = int(order[rank])
    scored = task.evaluator == "score"
    rng = np.random.default_rng(task.seed)
    steps = []
    skips = 0
    for index in range(task.steps):
        left, right = int(rng.integers(100)), 100 + int(rng.integers(100))
        skipped = task.method == "pbpo" and index >= 10 and index % 2 == 0
        skips += skipped
        response = "skip" if skipped else "left" if world.f[left] >= world.f[right] else "right"
        steps.append(
            Step(
                experiment=task.experiment,
                figures=" ".join(str(figure) for figure in task.figures),
                environment=task.environment,
                evaluator=task.evaluator,
                method=task.method,
                trial=task.trial,
                seed=task.seed,
                query_index=index,
                crane_runs=index + 1 if scored else 2 * (index + 1),
                trial_type="model",
                acquisition="made-up",
                left_candidate=left,
                right_candidate=None if scored else right,
                left_run=0,
                right_run=None if scored else 0,
                left_score=float(world.scores[left, 0]),
                right_score=None if scored else float(world.scores[right, 0]),
                response="score" if scored else response,
                answers=0 if scored else index + 1 - skips,
                skips=skips,
                preferences_answer=0 if scored else index + 1 - skips,
                preferences_synthesis=2 * skips,
                acquired=acquired,
                acquired_w0=float(world.candidates[acquired, 0]),
                acquired_w1=float(world.candidates[acquired, 1]),
                f=float(world.f[acquired]),
                engine_version="made-up",
            )
        )
    return Trial(task, steps)
