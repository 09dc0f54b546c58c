"""Tests between two methods, against answers worked out apart from them."""

from __future__ import annotations

import numpy as np
import pytest

from app.statistics.comparisons import SampleError, compare, interquartile_range

# Student's own sleep data (1908), as if unpaired: the two-sample results are in every textbook.
FIRST = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
SECOND = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]


def test_the_test_of_students_sleep_data_is_the_known_one() -> None:
    found = compare(FIRST, SECOND)
    assert found.difference == pytest.approx(-1.58)
    assert found.t == pytest.approx(-1.8608, abs=1e-4)
    assert found.p == pytest.approx(0.07919, abs=1e-5)
    assert (found.low, found.high) == pytest.approx((-3.365, 0.205), abs=1e-3)
    assert found.effect == pytest.approx(-0.8322 * (1 - 3 / 71), abs=1e-4)


def test_swapping_the_samples_turns_the_sign_and_nothing_else() -> None:
    one, other = compare(FIRST, SECOND), compare(SECOND, FIRST)
    assert (one.difference, one.t, one.effect) == pytest.approx(
        (-other.difference, -other.t, -other.effect)
    )
    assert one.p == pytest.approx(other.p)


def test_samples_that_never_vary_are_told_apart_without_a_division_by_zero() -> None:
    assert compare([1.0, 1.0], [1.0, 1.0]).p == 1.0
    apart = compare([2.0, 2.0], [1.0, 1.0])
    assert (apart.p, apart.difference, apart.significant) == (0.0, 1.0, True)


def test_one_sample_that_never_varies_is_compared_as_any_other() -> None:
    found = compare([-46.5] * 30, FIRST)
    assert found.t == pytest.approx(-148.624, abs=1e-3)
    assert found.low < found.difference < found.high
    # The interval's width is that of the other sample alone.
    assert found.high - found.difference == pytest.approx(1.2798, abs=1e-3)


def test_a_shift_by_many_deviations_has_two_stars_and_none_has_none() -> None:
    rng = np.random.default_rng(0)
    sample = list(rng.normal(size=30))
    assert compare([x + 5 for x in sample], sample).stars == "**"
    assert compare(sample, sample).stars == ""


def test_p_values_of_equal_distributions_are_below_a_twentieth_one_time_in_twenty() -> None:
    rng = np.random.default_rng(1)
    below = sum(
        compare(list(rng.normal(size=15)), list(rng.normal(size=15))).significant
        for _ in range(400)
    )
    assert 8 <= below <= 34  # 20 expected, standard deviation 4.4


def test_one_value_is_no_sample() -> None:
    with pytest.raises(SampleError, match="got 1 and 2"):
        compare([1.0], [1.0, 2.0])


def test_the_middle_half_of_a_row_of_numbers_is_half_its_width() -> None:
    assert interquartile_range(list(range(101))) == 50.0


def test_welchs_p_agrees_with_its_interval_where_students_contradicts_it() -> None:
    found = compare(FIRST, SECOND)
    assert (found.welch_t, found.welch_freedom) == pytest.approx((-1.8608, 17.776), abs=1e-3)
    assert found.welch_p == pytest.approx(0.07939, abs=1e-5)
    # Few and scattered against many and close: Student's test is far too sure of it.
    few, many = [30.0, -25.0, 40.0, -30.0, 44.0], [0.1 * (-1) ** n for n in range(40)]
    unequal = compare(few, many)
    assert unequal.p < 0.05 < unequal.welch_p
    assert unequal.low < 0 < unequal.high
