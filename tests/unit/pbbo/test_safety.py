"""The model of safety: what is near a refused point is unlikely to be proposed."""

from __future__ import annotations

import numpy as np
import pytest

from app.pbbo import Box
from app.pbbo.box_optimizer import BoxOptimizer
from app.pbbo.safety import Safety

SQUARE = Box(low=[0, 0], high=[1, 10])
NOTHING = np.empty((0, 2))


def test_without_a_refused_point_everything_is_safe() -> None:
    safety = Safety(SQUARE, np.array([[0.5, 5.0]]), NOTHING)
    assert not safety.is_in_doubt
    assert safety.probability(np.array([[0.1, 1.0], [0.9, 9.0]])).tolist() == [1.0, 1.0]


def test_the_probability_is_that_of_a_correlated_beta_process() -> None:
    safety = Safety(SQUARE, NOTHING, np.array([[0.5, 5.0]]))
    at = np.array([[0.5, 5.0], [0.6, 5.0], [0.5, 6.0], [0.5, 7.0], [0.5, 8.0]])
    # 0.25 / (0.25 + exp(-k^2 / 2)) at k tenths of the ranges.
    expected = [0.2, 0.29188, 0.29188, 0.64879, 0.95745]
    assert safety.probability(at) == pytest.approx(expected, abs=1e-5)


def test_a_point_that_was_run_is_safe_and_so_is_more_of_what_is_near() -> None:
    refused = np.array([[0.5, 5.0]])
    near = np.array([[0.6, 5.0], [0.62, 5.0]])
    alone = Safety(SQUARE, NOTHING, refused).probability(near)
    beside = Safety(SQUARE, near[:1], refused).probability(near)
    assert beside[0] == 1.0
    assert beside[1] > alone[1] + 0.3


def test_a_point_that_is_refused_after_it_was_run_is_refused() -> None:
    point = np.array([[0.5, 5.0]])
    assert Safety(SQUARE, point, point).probability(point)[0] == pytest.approx(0.2)


@pytest.mark.parametrize("new", [1, 2])
def test_points_near_refused_ones_are_seldom_proposed_nor_acquired(new: int) -> None:
    """Somebody likes one corner best, and no machine can run it."""

    def liked(point: np.ndarray) -> float:
        return float(-((point - 1.0) ** 2).sum())

    def distance(point: np.ndarray) -> float:
        return float(min(np.hypot(*(point - one)) for one in refused))

    space = Box(low=[0, 0], high=[1, 1])
    refused = [(0.95, 0.95), (0.85, 0.95), (0.95, 0.85)]
    optimizer = BoxOptimizer(space, seed=3, new=new)
    for one in refused:
        optimizer.exclude(one)
    near = 0
    for _ in range(12):
        query = optimizer.ask()
        for point in (query.left, query.right):
            is_new = not any(np.array_equal(point, shown) for shown in optimizer.shown)
            near += is_new and distance(point) < 0.1
        better = liked(query.left) >= liked(query.right)
        optimizer.tell(query, "left" if better else "right")
    assert near == 0
    assert distance(optimizer.best()) > 0.1
    assert liked(optimizer.best()) > liked(np.array([0.6, 0.6]))
