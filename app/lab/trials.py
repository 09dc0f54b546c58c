"""One trial: an optimiser, an evaluator who answers from g, and what is acquired after each step.

The optimiser never sees g where people, or those who stand in for them, are asked (paper
sections VI and VII); BO and RBO see nothing else. All methods of the paper run under its presets.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from app.pbbo import (
    ENGINE_VERSION,
    PRESETS,
    SCORE_METHODS,
    SCORE_PRESETS,
    PreferenceOptimizer,
    ScoreOptimizer,
    allows_skip,
)

from .environments import World
from .evaluators import Certain, Evaluator, Uncertain
from .experiments import Task
from .people import PEOPLE, Person, SkipReason
from .steps import Step

#: Streams of a trial's randomness apart from the optimiser's own (app.pbbo.randomness, from 1 on).
SHOWN_RUNS = 1001
ANSWERS = 1002


#: When an evaluator finds a run bad, in deviations of g above its mean; see `evaluator_for`.
SKIP_LEVEL: Final = 0.0


def run_trial(task: Task, world: World, skip_level: float | None = SKIP_LEVEL) -> list[Step]:
    """Every step of a trial: a pure function of the task, the world and the skip level."""
    # A fit works on matrices of a few dozen rows, which several threads only slow down.
    with threadpool_limits(limits=1):
        if task.method in SCORE_METHODS:
            return _measured(task, world)
        return _asked(task, world, skip_level)


def replayed(task: Task, world: World, steps: list[Step]) -> PreferenceOptimizer | ScoreOptimizer:
    """The optimiser as it was after these steps of a trial."""
    if task.method in SCORE_METHODS:
        return ScoreOptimizer.replay(
            world.candidates,
            [(step.left_candidate, step.left_score) for step in steps],
            method=task.method,
            seed=task.seed,
            settings=SCORE_PRESETS[f"paper-{task.environment}-{task.method}"],
        )
    return PreferenceOptimizer.replay(
        world.candidates,
        [(step.left_candidate, _required(step.right_candidate), step.response) for step in steps],
        method=task.method,
        seed=task.seed,
        settings=PRESETS[f"paper-{task.environment}"],
    )


def evaluator_for(task: Task, world: World, skip_level: float | None = SKIP_LEVEL) -> Evaluator:
    """Who answers the queries of this trial.

    skip_level: Certain and Uncertain skip when both runs lie below the mean of g plus this many of
    its deviations, or never, for None.
    """
    rng = np.random.default_rng([task.seed, ANSWERS])
    below = None if skip_level is None else world.mean + skip_level * world.deviation
    if task.evaluator == "certain":
        return Certain(skip_below=below)
    if task.evaluator == "uncertain":
        return Uncertain(rng, skip_below=below)
    if task.evaluator == "demanding":
        return Uncertain(rng, skip_below=world.mean + world.deviation)
    traits = PEOPLE[int(task.evaluator.removeprefix("person-")) - 1]
    reason: SkipReason = "equal" if task.method == "pbpo-no-synthesis" else "undesirable"
    return Person(traits, reason, world.mean, world.deviation, rng)


def _asked(task: Task, world: World, skip_level: float | None) -> list[Step]:
    settings = PRESETS[f"paper-{task.environment}"]
    optimizer = PreferenceOptimizer(world.candidates, task.method, task.seed, settings)
    evaluator = evaluator_for(task, world, skip_level)
    may_skip = allows_skip(task.method)
    shown = np.random.default_rng([task.seed, SHOWN_RUNS])
    steps: list[Step] = []
    skips = 0
    for index in range(task.steps):
        query = optimizer.ask()
        left_run, right_run = (int(run) for run in shown.integers(world.runs, size=2))
        left = float(world.scores[query.left, left_run])
        right = float(world.scores[query.right, right_run])
        response = evaluator.respond(left, right, may_skip=may_skip)
        optimizer.tell(query, response)
        skips += response == "skip"
        origins = [preference.origin for preference in optimizer.preferences]
        steps.append(
            _step(
                task,
                world,
                index,
                acquired=optimizer.best(),
                crane_runs=2 * (index + 1),
                trial_type=query.trial_type,
                acquisition=query.acquisition,
                left=(query.left, left_run, left),
                right=(query.right, right_run, right),
                response=response,
                skips=skips,
                origins=(origins.count("answer"), origins.count("synthesis")),
            )
        )
    return steps


def _measured(task: Task, world: World) -> list[Step]:
    settings = SCORE_PRESETS[f"paper-{task.environment}-{task.method}"]
    optimizer = ScoreOptimizer(world.candidates, task.method, task.seed, settings)
    shown = np.random.default_rng([task.seed, SHOWN_RUNS])
    steps: list[Step] = []
    for index in range(task.steps):
        candidate = optimizer.ask()
        run = int(shown.integers(world.runs))
        value = float(world.scores[candidate, run])
        optimizer.tell(candidate, value)
        random = index < settings.random_queries
        steps.append(
            _step(
                task,
                world,
                index,
                acquired=optimizer.best(),
                crane_runs=index + 1,
                trial_type="random" if random else "model",
                acquisition="random" if random else "ucb",
                left=(candidate, run, value),
                right=(None, None, None),
                response="score",
                skips=0,
                origins=(0, 0),
            )
        )
    return steps


def _step(
    task: Task,
    world: World,
    index: int,
    *,
    acquired: int,
    crane_runs: int,
    trial_type: str,
    acquisition: str,
    left: tuple[int, int, float],
    right: tuple[int, int, float] | tuple[None, None, None],
    response: str,
    skips: int,
    origins: tuple[int, int],
) -> Step:
    w0, w1 = (float(value) for value in world.candidates[acquired])
    return Step(
        experiment=task.experiment,
        figures=" ".join(str(figure) for figure in task.figures),
        environment=task.environment,
        evaluator=task.evaluator,
        method=task.method,
        trial=task.trial,
        seed=task.seed,
        query_index=index,
        crane_runs=crane_runs,
        trial_type=trial_type,
        acquisition=acquisition,
        left_candidate=left[0],
        right_candidate=right[0],
        left_run=left[1],
        right_run=right[1],
        left_score=left[2],
        right_score=right[2],
        response=response,
        answers=0 if response == "score" else index + 1 - skips,
        skips=skips,
        preferences_answer=origins[0],
        preferences_synthesis=origins[1],
        acquired=acquired,
        acquired_w0=w0,
        acquired_w1=w1,
        f=float(world.f[acquired]),
        engine_version=ENGINE_VERSION,
    )


def _required(candidate: int | None) -> int:
    if candidate is None:
        raise ValueError("a query of two choices has two candidates, this step has one")
    return candidate
