"""Which claims hold when simulated evaluators skip when."""

from collections.abc import Mapping

import numpy as np

from app.figures import svg
from app.lab.environments import World
from app.lab.experiments import ENVIRONMENTS, Task
from app.lab.results import Trial
from app.lab.skip_sensitivity import LEVELS, chart, skips, table, tasks
from app.lab.trials import evaluator_for, run_trial

from .conftest import made_up


def first_task(evaluator: str) -> Task:
    return next(
        task for task, _ in tasks(1) if (task.method, task.evaluator) == ("pbpo", evaluator)
    )


def test_a_level_says_below_what_both_runs_are_skipped(world: World) -> None:
    task = first_task("uncertain")
    between = world.mean + 0.5 * world.deviation

    answers = {
        level: evaluator_for(task, world, level).respond(between, between, may_skip=True)
        for level in LEVELS
    }

    assert {level for level, answer in answers.items() if answer == "skip"} == {1.0, 1.5, 2.0}


def test_a_higher_level_skips_more_and_level_0_is_that_of_the_reproduction(world: World) -> None:
    task = first_task("certain")
    short = Task(**{**task.__dict__, "steps": 8})

    def skipped(level: float | None) -> int:
        return run_trial(short, world, level)[-1].skips

    assert skipped(None) == 0
    assert skipped(2.0) >= skipped(0.0)
    assert run_trial(short, world, 0.0) == run_trial(short, world)


def test_methods_without_a_skip_run_once_and_pbpo_at_every_level() -> None:
    planned = tasks(2)

    of_pbpo = [level for task, level in planned if task.method == "pbpo"]
    others = [level for task, level in planned if task.method != "pbpo"]
    assert len(of_pbpo) == len(LEVELS) * 2 * 2 * 2
    assert set(others) == {0.0}
    assert len(others) == 2 * 2 * 2 * 2


def test_the_table_has_the_skips_and_every_claim_at_every_level(
    worlds: Mapping[str, World],
) -> None:
    trials: dict[tuple[str, float | None], Trial] = {}
    for task, level in tasks(6):
        rank = 0 if task.method == "pbpo" and level == 0.0 else 5 + task.trial
        trials[task.name, level] = made_up(task, worlds[task.environment], rank)

    printed = table(trials, worlds, 0)

    lines = printed.splitlines()
    assert lines[0] == "| | | none | -1.0 | -0.5 | +0.0 | +0.5 | +1.0 | +1.5 | +2.0 |"
    assert sum("skips in 30" in line for line in lines) == 2 * len(ENVIRONMENTS)
    [better] = [
        line for line in lines if "Fig. 13, env1" in line and "after 40 queries: better" in line
    ]
    assert better.split("|")[3:11] == [" · ", " · ", " · ", " holds ", *[" · "] * 4]
    assert np.isfinite(skips(trials, "certain", "env1", None))
    drawn = svg(chart(trials, worlds, 0))
    assert "PBPO against PBPO w/o skip after 40 queries: better" in drawn
