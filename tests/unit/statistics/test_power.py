"""Intervals and numbers of people against known answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from app.statistics.power import (
    PeopleNeeded,
    effect_interval,
    mean_interval,
    paired_power,
    people_needed,
)


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
    assert needed(differences.tolist())[1] == people


def test_the_interval_of_an_effect_is_that_of_the_noncentral_t() -> None:
    for effect, n in ((0.4, 20), (0.0, 5), (1.5, 12)):
        low, high = effect_interval(effect, n)
        observed = effect * np.sqrt(n)
        assert stats.nct.sf(observed, n - 1, low * np.sqrt(n)) == pytest.approx(0.1, abs=1e-6)
        assert stats.nct.cdf(observed, n - 1, high * np.sqrt(n)) == pytest.approx(0.1, abs=1e-6)


def test_few_people_give_a_wide_range_that_many_narrow() -> None:
    # 20 people with an effect of .49 may as well come from one of .2, or of .8.
    fewest, likely, most = needed([-0.5, 1.5] * 10)
    assert fewest < 20 < likely
    assert most > 5 * likely
    fewest, _, most = needed([-0.5, 1.5] * 1000)
    assert most - fewest < 10


def test_a_stricter_level_takes_more_people() -> None:
    assert needed([-0.5, 1.5] * 20) < needed([-0.5, 1.5] * 20, 0.05 / 9)


def needed(differences: list[float], alpha: float = 0.05) -> tuple[int, int, int]:
    found = people_needed(differences, alpha=alpha)
    assert found is not None
    assert found.fewest is not None
    assert found.likely is not None
    assert found.most is not None
    return found.fewest, found.likely, found.most


def test_where_nothing_can_be_told_nothing_is() -> None:
    assert people_needed([]) is None
    assert people_needed([1.0]) is None
    assert people_needed([0.0, 0.0]) is None
    nothing = people_needed([1.0, -1.0001] * 10)
    assert nothing is not None
    assert (nothing.likely, nothing.most) == (None, None)
    assert people_needed([2.0, 2.0, 2.0]) == PeopleNeeded(2, 2, 2)
