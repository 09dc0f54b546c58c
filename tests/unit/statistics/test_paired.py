"""The paired t-test and Holm's correction, against answers worked out apart from them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from app.statistics.comparisons import SampleError
from app.statistics.paired import compare_paired, holm

from .test_comparisons import FIRST, SECOND


def test_the_paired_test_of_students_sleep_data_is_the_known_one() -> None:
    found = compare_paired(FIRST, SECOND)
    assert (found.people, found.freedom) == (10, 9)
    assert found.difference == pytest.approx(-1.58)
    assert found.t == pytest.approx(-4.0621, abs=1e-4)
    assert found.p == pytest.approx(0.002833, abs=1e-6)
    assert (found.low, found.high) == pytest.approx((-2.4599, -0.7001), abs=1e-4)
    assert found.effect == pytest.approx(-1.58 / 1.22995, abs=1e-4)


def test_the_paired_test_is_scipys() -> None:
    rng = np.random.default_rng(3)
    for people in (2, 5, 40):
        first, second = rng.normal(size=(2, people))
        known = stats.ttest_rel(first, second)
        found = compare_paired(list(first), list(second))
        assert (found.t, found.p) == pytest.approx((known.statistic, known.pvalue))


def test_people_who_all_differ_alike_are_told_apart_without_a_division_by_zero() -> None:
    assert compare_paired([1.0, 2.0], [1.0, 2.0]).p == 1.0
    assert compare_paired([2.0, 3.0], [1.0, 2.0]).p == 0.0


def test_one_person_cannot_be_compared() -> None:
    with pytest.raises(SampleError, match="two people or more, got 1"):
        compare_paired([1.0], [2.0])
    with pytest.raises(ValueError, match="on both sides, got 1 and 2"):
        compare_paired([1.0], [2.0, 3.0])


def test_holms_p_values_are_those_of_r() -> None:
    # p.adjust(c(0.04, 0.01, 0.02, 0.9), "holm")
    assert holm([0.04, 0.01, 0.02, 0.9]) == pytest.approx((0.08, 0.04, 0.06, 0.9))
    assert holm([0.01, 0.02, 0.03, 0.04, 0.05]) == pytest.approx((0.05, 0.08, 0.09, 0.09, 0.09))
    assert holm([0.6, 0.7]) == (1.0, 1.0)
    assert holm([]) == ()


def test_holms_correction_keeps_the_error_of_a_family_at_a_twentieth() -> None:
    rng = np.random.default_rng(4)
    wrong = sum(min(holm(list(rng.uniform(size=9)))) < 0.05 for _ in range(1000))
    assert 30 <= wrong <= 72  # 50 expected, standard deviation 6.9
