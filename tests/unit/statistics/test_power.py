"""Intervals and numbers of people against known answers."""

from __future__ import annotations

import numpy as np
import pytest

from app.statistics.power import mean_interval, paired_power, people_needed


def test_an_interval_is_students() -> None:
    found = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    # t(0.975, 4) = 2.776, standard error 0.7071.
    assert (found.mean, found.n) == (3.0, 5)
    assert found.low == pytest.approx(3 - 2.776 * 0.7071, abs=1e-3)
    assert found.high == pytest.approx(3 + 2.776 * 0.7071, abs=1e-3)
    assert mean_interval([2.0]).low is None
    with pytest.raises(ValueError, match="at least one"):
        mean_interval([])


@pytest.mark.parametrize(
    ("effect", "people"),
    # Two-sided, 5 %, 80 %: as G*Power 3.1 gives them for the difference of two dependent means.
    [(0.2, 199), (0.5, 34), (0.8, 15)],
)
def test_the_number_of_people_is_the_known_one(effect: float, people: int) -> None:
    assert paired_power(effect, people) >= 0.8 > paired_power(effect, people - 1)
    spread = np.array([-1.0, 1.0] * 50)
    differences = spread / spread.std(ddof=1) + effect
    assert people_needed(differences.tolist()) == people


def test_where_nothing_can_be_told_nothing_is() -> None:
    assert people_needed([]) is None
    assert people_needed([1.0]) is None
    assert people_needed([1.0, -1.0]) is None
    assert people_needed([1.0, -1.0001] * 10) is None
    assert people_needed([2.0, 2.0, 2.0]) == 2
