"""One trial: what is shown, answered and acquired."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.lab.environments import World, WorldError
from app.lab.experiments import Task
from app.lab.trials import replayed, run_trial

TASK = Task("certain", (10, 11), "env1", "certain", "pbpo", 0, 1234, 12)


def test_a_trial_is_a_pure_function_of_its_task(world: World) -> None:
    assert run_trial(TASK, world) == run_trial(TASK, world)


def test_another_seed_is_another_trial(world: World) -> None:
    first, second = run_trial(TASK, world), run_trial(replace(TASK, seed=1), world)
    assert [s.left_candidate for s in first] != [s.left_candidate for s in second]


def test_each_step_shows_recorded_runs_and_what_was_acquired_after_it(world: World) -> None:
    for index, step in enumerate(run_trial(TASK, world)):
        assert step.query_index == index
        assert step.crane_runs == 2 * (index + 1)
        assert step.right_candidate is not None
        assert step.left_score == world.scores[step.left_candidate, step.left_run]
        assert step.right_score == world.scores[step.right_candidate, step.right_run]
        assert step.f == world.f[step.acquired]
        assert (step.acquired_w0, step.acquired_w1) == tuple(world.candidates[step.acquired])


def test_the_certain_evaluator_skips_two_bad_runs_and_else_prefers_the_better(world: World) -> None:
    responses = set()
    steps = [s for seed in range(4) for s in run_trial(replace(TASK, seed=seed), world)]
    for step in steps:
        assert step.right_score is not None
        best = max(step.left_score, step.right_score)
        if best < world.mean:
            assert step.response == "skip"
        else:
            side = "left" if step.left_score >= step.right_score else "right"
            assert step.response == side
        responses.add(step.response)
    assert responses == {"left", "right", "skip"}


def test_counts_of_answers_skips_and_preferences_add_up(world: World) -> None:
    last = run_trial(replace(TASK, steps=30), world)[-1]
    assert last.answers + last.skips == 30
    assert last.preferences_answer == last.answers
    assert last.preferences_synthesis == 2 * last.skips


def test_a_demanding_evaluator_skips_what_lies_below_one_deviation_above_the_mean(
    world: World,
) -> None:
    for step in run_trial(replace(TASK, evaluator="demanding"), world):
        bad = max(step.left_score, step.right_score or 0.0) < world.mean + world.deviation
        assert (step.response == "skip") == bad


@pytest.mark.parametrize("method", ["pbpo-no-skip", "knockout"])
def test_methods_without_a_skip_are_never_skipped(world: World, method: str) -> None:
    steps = run_trial(replace(TASK, method=method), world)
    assert {step.response for step in steps} <= {"left", "right"}


def test_without_synthesis_people_skip_equal_runs_and_nothing_is_learned_from_it(
    world: World,
) -> None:
    task = replace(TASK, evaluator="person-5", method="pbpo-no-synthesis", steps=40)
    steps = run_trial(task, world)
    skipped = [s for s in steps if s.response == "skip"]
    assert skipped
    assert all(abs(s.left_score - (s.right_score or 0.0)) < 10.0 for s in skipped)
    assert steps[-1].preferences_synthesis == 0


def test_one_step_of_bo_is_one_run_of_the_crane(world: World) -> None:
    steps = run_trial(replace(TASK, evaluator="score", method="bo"), world)
    assert [step.crane_runs for step in steps] == list(range(1, 13))
    assert {step.response for step in steps} == {"score"}
    assert all(step.right_candidate is None for step in steps)
    assert [s.trial_type for s in steps] == ["random"] * 5 + ["model"] * 7


@pytest.mark.parametrize(("evaluator", "method"), [("certain", "pbpo"), ("score", "rbo")])
def test_a_stored_trial_gives_its_optimiser_back(world: World, evaluator: str, method: str) -> None:
    task = replace(TASK, evaluator=evaluator, method=method)
    steps = run_trial(task, world)
    for count in (7, 12):
        assert replayed(task, world, steps[:count]).best() == steps[count - 1].acquired


def test_certain_answers_lead_near_the_peak_of_a_smooth_world(world: World) -> None:
    regrets = [
        world.f[world.best] - run_trial(replace(TASK, seed=seed, steps=40), world)[-1].f
        for seed in range(3)
    ]
    at_random = world.f[world.best] - world.f.mean()
    assert np.mean(regrets) < 0.25 * at_random


def test_candidates_without_scores_are_no_world() -> None:
    with pytest.raises(WorldError, match=r"expected scores \(3, runs\)"):
        World("env1", np.zeros((3, 2)), np.zeros((4, 5)))
    with pytest.raises(WorldError, match=r"candidates \(n, 2\)"):
        World("env1", np.zeros((3, 1)), np.zeros((3, 5)))
