"""Bradley and Terry's model (1952): how strong each of several is, from who won against whom.

log odds that i wins against j = s_i - s_j, with the strengths' mean at 0. A few half games against
an opponent of average strength keep strengths finite where somebody won, or lost, every time
(Agresti, Categorical Data Analysis, 3rd ed., sections 1.4 and 11.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from .shares import DEVIATIONS_95

#: Games that each is taken to have won, and lost, against an average opponent.
HALF_GAME: Final = 0.5
_MOST_STEPS: Final = 100
_PRECISION: Final = 1e-10


@dataclass(frozen=True)
class WinRate:
    """How often one would win against the average of all, with its 95 % interval.

    strength: its log odds. error: the standard error of that. wins, games: as counted.
    """

    wins: int
    games: int
    strength: float
    error: float
    value: float
    low: float
    high: float


def win_rates(
    count: int, results: Sequence[tuple[int, int]], half_game: float = HALF_GAME
) -> tuple[WinRate, ...]:
    """The win rate of each of `count` players, by number; results: (winner, loser) of each game.

    Games are taken to be independent: where one person gave many of the answers, the intervals are
    narrower than they ought to be. Raises ValueError for a game with itself or an unknown player.
    """
    wins = np.zeros((count, count))
    for winner, loser in results:
        if winner == loser or not (0 <= winner < count and 0 <= loser < count):
            raise ValueError(
                f"expected two different players from 0 to {count - 1}, got {winner} and {loser}"
            )
        wins[winner, loser] += 1
    strengths, covariance = _fitted(wins, half_game)
    won, games = wins.sum(axis=1), (wins + wins.T).sum(axis=1)
    rates = []
    for player in range(count):
        strength = float(strengths[player])
        error = float(np.sqrt(max(covariance[player, player], 0.0)))
        low, value, high = expit(
            [strength - DEVIATIONS_95 * error, strength, strength + DEVIATIONS_95 * error]
        )
        rates.append(
            WinRate(
                int(won[player]),
                int(games[player]),
                strength,
                error,
                float(value),
                float(low),
                float(high),
            )
        )
    return tuple(rates)


def _fitted(
    wins: NDArray[np.float64], half_game: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Strengths (n,) and their covariance (n, n), by Newton's method: the likelihood is concave."""
    games = wins + wins.T
    strengths = np.zeros(len(wins))
    inverse = np.zeros_like(wins)
    for _ in range(_MOST_STEPS):
        expected = expit(strengths[:, None] - strengths[None, :])
        against_average = expit(strengths)
        gradient = (wins - games * expected).sum(axis=1)
        gradient += half_game * (1 - 2 * against_average)
        weights = games * expected * (1 - expected)
        information = np.diag(
            weights.sum(axis=1) + 2 * half_game * against_average * (1 - against_average)
        )
        information -= weights
        # Without half games only differences are known: the mean stays at 0.
        inverse = np.linalg.pinv(information, hermitian=True)
        step = inverse @ gradient
        # A step beyond a few log odds has left what the quadratic is true of.
        strengths = strengths + step / max(1.0, float(np.abs(step).max()) / 2)
        if np.abs(step).max() < _PRECISION:
            break
    # Against the mean of all: how they stand to the opponent of the half games is no matter.
    centring = np.eye(len(wins)) - 1 / len(wins)
    return centring @ strengths, centring @ inverse @ centring
