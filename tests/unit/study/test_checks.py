"""Checks between the queries of a trial: where they come, and what a plan may ask for."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study import Plan
from app.study.attention_checks import Kind, number, schedule

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]
BuildPlan = Callable[..., Plan]


@given(st.integers(1, 60), st.data())
def test_every_query_comes_and_every_check_with_room_to_be_one(
    queries: int, data: st.DataObject
) -> None:
    repeats = data.draw(st.integers(0, (queries - 1) // 2))
    attention = data.draw(st.integers(0, queries // 2))
    seed = data.draw(st.integers(0, 2**32))
    places = schedule(queries, repeats, attention, np.random.default_rng(seed))
    assert [places.count(kind) for kind in Kind] == [queries, repeats, attention]
    assert places[0] is Kind.MODEL
    for place, kind in enumerate(places):
        if kind is not Kind.MODEL:
            assert places[place - 1] is Kind.MODEL
        if kind is Kind.REPEAT:
            before = places[: place - 1]
            assert before.count(Kind.MODEL) > before.count(Kind.REPEAT)


def test_the_places_follow_from_the_seed_and_differ_between_seeds() -> None:
    drawn = [schedule(30, 3, 3, np.random.default_rng(seed)) for seed in range(20)]
    assert drawn == [schedule(30, 3, 3, np.random.default_rng(seed)) for seed in range(20)]
    assert len(set(drawn)) > 10


def test_too_many_checks_for_a_trial_are_refused() -> None:
    with pytest.raises(ValueError, match="expected room after 1 queries"):
        schedule(1, 1, 0, np.random.default_rng(0))


@pytest.mark.parametrize(("share", "queries", "checks"), [(0.1, 30, 3), (0.1, 4, 0), (0.5, 5, 3)])
def test_a_share_makes_the_nearest_whole_number(share: float, queries: int, checks: int) -> None:
    assert number(share, queries) == checks


def test_a_plan_counts_the_checks_among_what_a_trial_shows(build_plan: BuildPlan) -> None:
    plan = build_plan(queries_per_trial=10, checks={"repeats": 0.2, "attention": 0.1})
    assert plan.shown_per_trial == 13
    assert Plan.model_validate(plan.model_dump(mode="json")) == plan
    assert build_plan().shown_per_trial == 3


@pytest.mark.parametrize(
    ("checks", "expected"),
    [
        (
            "{repeats: 0.1}",
            "checks.repeats: expected a share that makes one of 4 queries at least, got 0.1",
        ),
        (
            "{repeats: 0.6}",
            "checks.repeats: expected a share of queries_per_trial from 0 (none) to 0.5, got 0.6",
        ),
        ("{good: [{speed: 0.1, height: 1}]}", "checks.good: expected candidates in bad as well"),
        (
            "{good: [{speed: 0.1}], bad: [{speed: 0.2, height: 1}]}",
            "checks.good[0]: expected the parameters speed, height, got speed",
        ),
        (
            "{good: [{speed: 0.1, height: 1}], bad: [{speed: 0.1, height: 1}]}",
            "checks.bad[0]: expected a candidate that is not in good as well",
        ),
        (
            "{good: [{speed: 0.1, height: 1}], bad: [{speed: 0.3, height: 1}]}",
            "checks.bad[0]: expected a candidate of environment kitchen, got speed 0.3, height 1",
        ),
        (
            "{in_model: 1}",
            "checks.in_model: expected true or false: whether the model learns from checks, got 1",
        ),
    ],
)
def test_checks_that_cannot_be_made_are_named(
    folder: Path, edit: Edit, faults: Faults, checks: str, expected: str
) -> None:
    edit(folder / "study.yaml", "queries_per_trial: 4", f"queries_per_trial: 4\nchecks: {checks}")
    found = faults(folder)
    assert any(fault.startswith(f"study.yaml:20: {expected}") for fault in found), found


def test_without_scores_and_without_candidates_there_is_nothing_known(
    folder: Path, edit: Edit, faults: Faults
) -> None:
    edit(
        folder / "study.yaml",
        "queries_per_trial: 4",
        "queries_per_trial: 4\nchecks: {attention: 0.25}",
    )
    assert faults(folder) == []
    edit(folder / "recordings.csv", ",-1e1", ",")
    (fault,) = faults(folder)
    assert fault == (
        "study.yaml:20: checks.attention: expected candidates in good and bad, or scores of at"
        " least two candidates of environment kitchen, got 1 recordings with a score"
    )
