"""Blocks of one environment each: videos to watch, then all its trials."""

from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import pytest
from pydantic import ValidationError

from app.study import (
    Consented,
    Continued,
    Plan,
    Progress,
    Responded,
    Stage,
    WatchMore,
    advance,
    plan_orders,
    trial_conditions,
)

NOON = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
ENVIRONMENTS = {"wet": {"source": "wet.csv"}, "dry": {"source": "dry.csv"}}


def condition(name: str, environment: str) -> dict[str, str]:
    return {"name": name, "method": "knockout", "environment": environment}


# The environments come mixed here, and in blocks all the same.
CONDITIONS = [
    condition("wet a", "wet"),
    condition("dry a", "dry"),
    condition("wet b", "wet"),
    condition("dry b", "dry"),
]


@pytest.fixture
def plan(build_plan: Callable[..., Plan]) -> Plan:
    return build_plan(
        environments=ENVIRONMENTS,
        conditions=CONDITIONS,
        blocks="environment",
        trials_per_condition=2,
        queries_per_trial=1,
        break_s=60,
        familiarisation={"videos": 3, "required": 2},
    )


def environments(plan: Plan, order: tuple[int, ...]) -> list[str]:
    return [plan.conditions[index].environment for index in trial_conditions(plan, order)]


def test_the_trials_of_an_environment_come_together_and_hold_each_condition_as_often(
    plan: Plan,
) -> None:
    for order in plan_orders(plan):
        came = environments(plan, order)
        assert came in (["wet"] * 4 + ["dry"] * 4, ["dry"] * 4 + ["wet"] * 4)
        assert set(Counter(trial_conditions(plan, order)).values()) == {2}


def test_each_environment_and_each_condition_is_first_equally_often(plan: Plan) -> None:
    orders = plan_orders(plan)
    assert len(orders) == len(set(orders)) == 4
    assert Counter(order[0] for order in orders) == {0: 1, 1: 1, 2: 1, 3: 1}
    assert Counter(order[2] for order in orders) == {0: 1, 1: 1, 2: 1, 3: 1}


def test_a_fixed_order_in_blocks_takes_the_environments_as_they_come(
    build_plan: Callable[..., Plan],
) -> None:
    plan = build_plan(
        environments=ENVIRONMENTS, conditions=CONDITIONS, blocks="environment", order="fixed"
    )
    assert plan_orders(plan) == ((0, 2, 1, 3),)


def test_each_block_begins_with_its_videos_and_no_other_trial_does(plan: Plan) -> None:
    progress = advance(plan, Progress.start(), Consented("v", "v"))
    stages = []
    at = NOON
    while progress.stage is not Stage.DEBRIEF:
        if progress.stage is Stage.QUERY:
            progress = advance(plan, progress, Responded(0, at))
        else:
            at += timedelta(seconds=60)
            progress = advance(plan, progress, Continued(at, watched=2))
        stages.append(progress.stage)
    trial = [Stage.QUERY, Stage.BREAK]
    block = [Stage.FAMILIARISATION, *trial * 4]
    assert stages == [*block, *block[:-1], Stage.DEBRIEF]


def test_videos_that_are_required_hold_back_whoever_has_watched_too_few(plan: Plan) -> None:
    watching = Progress(Stage.FAMILIARISATION, trial_index=4)
    with pytest.raises(WatchMore, match="expected 2 watched to the end, got 1") as caught:
        advance(plan, watching, Continued(NOON, watched=1))
    assert caught.value.left == 1
    assert advance(plan, watching, Continued(NOON, watched=2)) == Progress(
        Stage.QUERY, trial_index=4
    )


def test_blocks_of_different_lengths_are_refused(build_plan: Callable[..., Plan]) -> None:
    with pytest.raises(
        ValidationError,
        match="blocks: expected as many conditions in each environment, got 2 in wet, 1 in dry",
    ):
        build_plan(environments=ENVIRONMENTS, conditions=CONDITIONS[:3], blocks="environment")


@pytest.mark.parametrize("speeds", [[], [0], [5], ["fast"], [float("nan")]])
def test_speeds_beyond_what_can_be_watched_are_refused(
    build_plan: Callable[..., Plan], speeds: list[object]
) -> None:
    with pytest.raises(ValidationError, match="speeds"):
        build_plan(familiarisation={"videos": 3, "speeds": speeds})
