"""How sure the belief is of its best candidate."""

import numpy as np
import pytest

from app.pbbo import NoPosteriorError, PreferenceOptimizer, SurenessError
from app.pbbo.candidates import FloatArray

TRIANGLE: FloatArray = np.array([(i / 20, j / 20) for i in range(21) for j in range(i + 1)])


def after(queries: int, method: str = "pbpo-threshold", seed: int = 1) -> PreferenceOptimizer:
    taste = -((TRIANGLE - (0.6, 0.35)) ** 2).sum(axis=1)
    optimizer = PreferenceOptimizer(TRIANGLE, method, seed)
    for _ in range(queries):
        query = optimizer.ask()
        optimizer.tell(query, "left" if taste[query.left] >= taste[query.right] else "right")
    return optimizer


@pytest.mark.parametrize("method", ["pbpo-threshold", "pbpo"])
def test_it_rises_as_answers_come_and_with_what_is_tolerated(method: str) -> None:
    few, many = after(3, method), after(30, method)

    assert many.sureness(0.1) > few.sureness(0.1)
    shares = [many.sureness(within) for within in (0.0, 0.05, 0.2, 1.0)]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_asking_how_sure_changes_nothing_and_says_the_same_again() -> None:
    asked, other = after(12), after(12)

    said = asked.sureness(0.1)

    assert asked.sureness(0.1) == said == other.sureness(0.1)
    assert asked.ask() == other.ask()


def test_the_set_that_may_be_best_shrinks_and_holds_the_truth() -> None:
    few, many = after(3), after(30)

    assert len(many.may_be_best()) < len(few.may_be_best())
    assert set(many.may_be_best(0.5)) <= set(many.may_be_best(0.95))
    truth = int(np.argmin(((TRIANGLE - (0.6, 0.35)) ** 2).sum(axis=1)))
    assert truth in many.may_be_best()


def test_many_candidates_are_served() -> None:
    points = np.random.default_rng(0).random((1500, 3))
    optimizer = PreferenceOptimizer(points, "pbpo-threshold", 1)
    for response in ("left", "right", "skip", "left", "left", "left"):
        optimizer.tell(optimizer.ask(), response)

    assert 0.0 <= optimizer.sureness(0.1) <= 1.0
    assert optimizer.ask().trial_type == "model"


@pytest.mark.parametrize("within", [-0.1, 1.1, "much", None, True, float("nan")])
def test_a_share_out_of_range_is_refused(within: object) -> None:
    optimizer = after(2)

    with pytest.raises(SurenessError, match=r"within: expected a number from 0 to 1, got"):
        optimizer.sureness(within)  # type: ignore[arg-type]
    with pytest.raises(SurenessError, match=r"probability: expected a number from 0 to 1, got"):
        optimizer.may_be_best(within)  # type: ignore[arg-type]


def test_a_method_without_a_model_is_not_sure_of_anything() -> None:
    with pytest.raises(NoPosteriorError, match=r"knockout keeps no model"):
        PreferenceOptimizer(TRIANGLE, "knockout").sureness(0.1)
