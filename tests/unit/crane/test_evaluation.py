"""g and f (Eqs. 13 and 14) on weight series whose score is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.crane.evaluation import WeightSeriesError, ideal, objective, score

SAMPLES = 501
RAMP = np.linspace(0.0, 1.0, SAMPLES)


def test_a_straight_fall_to_zero_scores_zero() -> None:
    assert score(180.0 * (1.0 - RAMP)) == pytest.approx(0.0, abs=1e-12)


def test_holding_everything_costs_the_initial_weight_over_root_three() -> None:
    assert score(np.full(SAMPLES, 300.0)) == pytest.approx(-300.0 / np.sqrt(3.0), rel=2e-3)


def test_dropping_everything_at_once_costs_about_as_much_as_holding_everything() -> None:
    dropped = np.zeros(SAMPLES)
    dropped[0] = 300.0
    assert score(dropped) == pytest.approx(score(np.full(SAMPLES, 300.0)), rel=5e-3)


def test_a_constant_offset_from_the_ideal_costs_that_offset() -> None:
    weight = 100.0 * (1.0 - RAMP)
    weight[1:] += 7.0
    assert score(weight) == pytest.approx(-7.0, rel=2e-3)


def test_each_run_is_measured_against_its_own_initial_weight() -> None:
    runs = np.stack([start * (1.0 - RAMP) for start in (50.0, 150.0, 400.0)])
    np.testing.assert_allclose(score(runs), 0.0, atol=1e-12)


def test_scores_keep_the_leading_axes_and_equal_one_run_at_a_time() -> None:
    runs = np.random.default_rng(3).uniform(0.0, 200.0, size=(4, 5, SAMPLES))
    together = score(runs)
    assert together.shape == (4, 5)
    one_by_one = [[float(score(runs[i, k])) for k in range(5)] for i in range(4)]
    np.testing.assert_array_equal(together, one_by_one)


@given(factor=st.floats(0.01, 1000.0), seed=st.integers(0, 2**32 - 1))
def test_a_load_twice_as_heavy_scores_twice_as_low(factor: float, seed: int) -> None:
    weight = np.sort(np.random.default_rng(seed).uniform(1.0, 100.0, size=SAMPLES))[::-1]
    assert score(factor * weight) == pytest.approx(factor * float(score(weight)), rel=1e-9)


def test_the_ideal_falls_in_a_straight_line_from_each_initial_weight_to_zero() -> None:
    lines = ideal(np.array([10.0, 20.0]), 3)
    np.testing.assert_allclose(lines, [[10.0, 5.0, 0.0], [20.0, 10.0, 0.0]])


def test_f_is_the_mean_of_g_over_the_runs() -> None:
    np.testing.assert_allclose(objective([[-1.0, -3.0], [-10.0, -20.0]]), [-2.0, -15.0])


@pytest.mark.parametrize("weight", [3.0, [3.0], np.zeros((4, 0))])
def test_something_that_is_no_series_is_refused_with_its_shape(weight: object) -> None:
    with pytest.raises(WeightSeriesError, match="at least 2 samples, got an array of shape"):
        score(np.asarray(weight))
