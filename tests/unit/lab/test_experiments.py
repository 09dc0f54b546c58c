"""What is run for which figure."""

from __future__ import annotations

from collections import Counter

import pytest

from app.lab.experiments import (
    EXPERIMENTS,
    FIGURES,
    Experiment,
    ExperimentError,
    chosen_figures,
    plan,
    seed_of,
)


def test_figures_10_to_13_take_fifty_trials_of_eighty_queries_of_each_method_in_each_world() -> (
    None
):
    tasks = plan((10, 11, 12, 13), 0)
    counts = Counter((task.evaluator, task.environment, task.method) for task in tasks)
    assert set(counts.values()) == {50}
    # Beside the paper's: PBPO with an evaluator who skips more.
    assert len(counts) == 2 * 2 * 3 + 2
    assert {task.steps for task in tasks} == {80}


def test_in_figure_17_each_of_five_evaluators_has_three_trials_of_each_method() -> None:
    counts = Counter((t.environment, t.method, t.evaluator) for t in plan((17,), 0))
    assert set(counts.values()) == {3}
    assert len(counts) == 2 * 3 * 5


def test_figure_21_needs_only_trials_with_the_skip_that_it_counts() -> None:
    assert {task.method for task in plan((21,), 0)} == {"pbpo"}


def test_figure_9_needs_no_trial() -> None:
    assert plan((9,), 0) == []


def test_every_trial_has_a_name_and_a_seed_of_its_own() -> None:
    tasks = plan(FIGURES, 0)
    assert len({task.name for task in tasks}) == len({task.seed for task in tasks}) == len(tasks)


def test_a_trial_is_the_same_however_many_there_are_and_whatever_else_is_drawn() -> None:
    few, many = plan((10,), 7, trials=3), plan(FIGURES, 7)
    assert set(few) <= set(many)


def test_another_root_seed_changes_every_trial() -> None:
    assert not {t.seed for t in plan((10,), 0)} & {t.seed for t in plan((10,), 1)}


def test_seeds_fit_where_they_are_stored() -> None:
    assert all(0 <= seed_of(0, "any", index) < 2**63 for index in range(200))


@pytest.mark.parametrize(
    ("text", "figures"), [(None, FIGURES), ("10", (10,)), ("12, 10,10", (10, 12))]
)
def test_figures_are_named_by_number(text: str | None, figures: tuple[int, ...]) -> None:
    assert chosen_figures(text) == figures


@pytest.mark.parametrize("text", ["", "14", "10,", "ten", "10;12"])
def test_a_figure_that_is_none_is_named(text: str) -> None:
    with pytest.raises(ExperimentError, match="expected some of 9, 10"):
        chosen_figures(text)


def test_an_experiment_of_an_unknown_method_is_refused() -> None:
    with pytest.raises(ExperimentError, match="got 'magic'"):
        Experiment("x", "certain", {"magic": (10,)}, trials=1, steps=1)
    with pytest.raises(ExperimentError, match="got 'bo'"):
        Experiment("x", "certain", {"bo": (10,)}, trials=1, steps=1)


def test_an_experiment_without_trials_is_refused() -> None:
    with pytest.raises(ExperimentError, match="trials from 1 on, got 0"):
        Experiment("x", "certain", {"pbpo": (10,)}, trials=0, steps=1)


def test_every_figure_of_trials_is_shown_by_some_experiment() -> None:
    shown = {f for one in EXPERIMENTS for figures in one.arms.values() for f in figures}
    assert shown | {9} == set(FIGURES)
