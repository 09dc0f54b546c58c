"""Win rates and shares, against answers that are published or can be worked out by hand."""

from __future__ import annotations

from math import log, sqrt

import pytest

from app.statistics.shares import share
from app.statistics.win_rates import win_rates

# Baseball, American League East, 1987: Agresti, Categorical Data Analysis, table 11.10.
TEAMS = ("Milwaukee", "Detroit", "Toronto", "New York", "Boston", "Cleveland", "Baltimore")
WINS = (
    (0, 7, 9, 7, 7, 9, 11),
    (6, 0, 7, 5, 11, 9, 9),
    (4, 6, 0, 7, 7, 8, 12),
    (6, 8, 6, 0, 6, 7, 10),
    (6, 2, 6, 7, 0, 7, 12),
    (4, 4, 5, 6, 6, 0, 6),
    (2, 4, 1, 3, 1, 7, 0),
)
PUBLISHED = (1.581, 1.436, 1.294, 1.248, 1.108, 0.684, 0.0)


def test_the_strengths_of_the_baseball_teams_are_the_published_ones() -> None:
    games = [
        (winner, loser)
        for winner, row in enumerate(WINS)
        for loser, won in enumerate(row)
        for _ in range(won)
    ]
    rates = win_rates(len(TEAMS), games, half_game=0.0)
    over_the_last = [rate.strength - rates[-1].strength for rate in rates]
    assert over_the_last == pytest.approx(PUBLISHED, abs=2e-3)
    assert rates[0].wins == 50
    assert rates[0].games == 78


def test_of_two_the_odds_are_those_that_were_counted() -> None:
    first, second = win_rates(2, [(0, 1)] * 3 + [(1, 0)], half_game=0.0)
    assert first.strength - second.strength == pytest.approx(log(3))
    # The difference has the error of a binomial's log odds; each of the two has half of it.
    assert first.error == pytest.approx(sqrt(1 / 3 + 1 / 1) / 2)


def test_who_always_wins_is_strong_but_not_infinitely_so() -> None:
    best, middle, worst = win_rates(3, [(0, 1), (0, 2), (1, 2)] * 5)
    assert 1 > best.value > middle.value > worst.value > 0
    assert middle.value == pytest.approx(0.5)
    assert best.high > best.value > best.low > 0.5


def test_who_never_played_is_average_and_unknown() -> None:
    unknown = win_rates(3, [(0, 1)] * 10)[2]
    assert unknown.games == 0
    assert unknown.value == pytest.approx(0.5)
    assert unknown.low < 0.1
    assert unknown.high > 0.9


@pytest.mark.parametrize("game", [(0, 0), (0, 2), (-1, 0)])
def test_a_game_that_cannot_be_is_refused(game: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="expected two different players from 0 to 1"):
        win_rates(2, [game])


def test_a_shares_interval_is_wilsons() -> None:
    found = share(8, 10)
    assert (found.low, found.value, found.high) == pytest.approx((0.4902, 0.8, 0.9433), abs=1e-4)


def test_the_interval_of_none_and_of_all_stays_within_0_and_1() -> None:
    assert share(0, 5).low == 0.0
    assert share(5, 5).high == 1.0
    assert share(0, 5).high == pytest.approx(1 - share(5, 5).low)


@pytest.mark.parametrize(("part", "whole"), [(-1, 3), (4, 3), (0, 0)])
def test_a_share_of_nothing_is_refused(part: int, whole: int) -> None:
    with pytest.raises(ValueError, match="expected a part from 0"):
        share(part, whole)
