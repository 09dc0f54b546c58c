"""Orders of conditions are balanced, sessions are spread over them, videos are drawn fairly."""

from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study import (
    Plan,
    choose_order,
    orders,
    plan_orders,
    sample_familiarisation,
    trial_conditions,
)

numbers_of_conditions = st.integers(min_value=1, max_value=12)


def test_three_conditions_have_the_six_orders_of_a_williams_design() -> None:
    assert set(orders(3)) == {(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 2, 1), (1, 0, 2)}


def test_four_conditions_have_the_known_square() -> None:
    assert orders(4) == ((0, 1, 3, 2), (1, 2, 0, 3), (2, 3, 1, 0), (3, 0, 2, 1))


@given(n=numbers_of_conditions)
def test_every_order_holds_each_condition_once(n: int) -> None:
    assert len(orders(n)) == (n if n % 2 == 0 or n == 1 else 2 * n)
    assert all(sorted(order) == list(range(n)) for order in orders(n))


@given(n=numbers_of_conditions)
def test_each_condition_is_once_at_each_position_in_every_n_orders(n: int) -> None:
    every_order = orders(n)
    for start in range(0, len(every_order), n):
        square = every_order[start : start + n]
        for column in zip(*square, strict=True):
            assert sorted(column) == list(range(n))


@given(n=numbers_of_conditions)
def test_each_condition_follows_each_other_equally_often(n: int) -> None:
    follows = Counter(pair for order in orders(n) for pair in pairwise(order))
    expected = 0 if n == 1 else len(orders(n)) // n
    assert follows == {(a, b): expected for a in range(n) for b in range(n) if a != b}


def test_no_conditions_have_no_orders() -> None:
    with pytest.raises(ValueError, match="at least one condition, got 0"):
        orders(0)


@given(
    counts=st.lists(st.integers(min_value=0, max_value=50), min_size=1, max_size=12),
    seed=st.integers(min_value=0, max_value=2**32),
)
def test_a_session_gets_an_order_that_the_fewest_have(counts: list[int], seed: int) -> None:
    chosen = choose_order(counts, np.random.default_rng(seed))
    assert counts[chosen] == min(counts)


@given(n=st.integers(1, 8), sessions=st.integers(0, 60), seed=st.integers(0, 2**32))
def test_orders_never_differ_by_more_than_one_session(n: int, sessions: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = [0] * len(orders(n))
    for _ in range(sessions):
        counts[choose_order(counts, rng)] += 1
    assert max(counts) - min(counts) <= 1


def test_equal_counts_are_decided_by_chance_alone() -> None:
    chosen = Counter(choose_order([2, 5, 2, 2], np.random.default_rng(seed)) for seed in range(300))
    assert set(chosen) == {0, 2, 3}
    # 300 draws of three: five standard deviations around 100.
    assert all(60 < times < 140 for times in chosen.values())


@pytest.mark.parametrize("counts", [[], [1, -1]])
def test_counts_that_cannot_be_are_refused(counts: list[int]) -> None:
    with pytest.raises(ValueError, match="a count of 0 or more"):
        choose_order(counts, np.random.default_rng(0))


def test_a_fixed_study_has_one_order_as_listed(build_plan: Callable[..., Plan]) -> None:
    assert plan_orders(build_plan(order="fixed")) == ((0, 1),)
    assert plan_orders(build_plan(order="counterbalanced")) == ((0, 1), (1, 0))


def test_trials_repeat_the_order(build_plan: Callable[..., Plan]) -> None:
    plan = build_plan(trials_per_condition=3)
    assert trial_conditions(plan, (1, 0)) == (1, 0, 1, 0, 1, 0)
    assert len(trial_conditions(plan, (1, 0))) == plan.trials


@pytest.mark.parametrize("order", [(0,), (0, 0), (0, 1, 2), (1, 2)])
def test_an_order_of_other_conditions_is_refused(
    build_plan: Callable[..., Plan], order: tuple[int, ...]
) -> None:
    with pytest.raises(ValueError, match="each of the 2 conditions once"):
        trial_conditions(build_plan(), order)


@given(n=st.integers(1, 40), k=st.integers(0, 100), seed=st.integers(0, 2**32))
def test_no_video_comes_again_before_all_have_come(n: int, k: int, seed: int) -> None:
    drawn = sample_familiarisation(n, k, np.random.default_rng(seed))
    assert len(drawn) == k
    assert all(0 <= index < n for index in drawn)
    for start in range(0, k, n):
        batch = drawn[start : start + n]
        assert len(set(batch)) == len(batch)


def test_the_same_seed_draws_the_same_videos() -> None:
    first, second = (sample_familiarisation(231, 10, np.random.default_rng(7)) for _ in range(2))
    assert first == second
    assert first != sample_familiarisation(231, 10, np.random.default_rng(8))


@pytest.mark.parametrize(("n", "k"), [(0, 1), (5, -1)])
def test_videos_that_are_not_there_cannot_be_drawn(n: int, k: int) -> None:
    with pytest.raises(ValueError, match="expected recordings to draw"):
        sample_familiarisation(n, k, np.random.default_rng(0))
