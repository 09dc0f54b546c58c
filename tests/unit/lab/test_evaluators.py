"""Evaluators who answer from the scores of the two runs they are shown."""

from __future__ import annotations

import numpy as np
import pytest

from app.lab.evaluators import ETA, Certain, Uncertain


@pytest.mark.parametrize(
    ("left", "right", "response"), [(-10, -20, "left"), (-20, -10, "right"), (-5, -5, "left")]
)
def test_the_certain_one_chooses_the_better_run(left: float, right: float, response: str) -> None:
    assert Certain().respond(left, right, may_skip=False) == response
    assert Certain().respond(left, right, may_skip=True) == response


@pytest.mark.parametrize("kind", ["certain", "uncertain"])
def test_both_skip_two_bad_runs_where_they_may(kind: str) -> None:
    rng = np.random.default_rng(0)
    evaluator = Certain(-50) if kind == "certain" else Uncertain(rng, -50)
    assert evaluator.respond(-60, -70, may_skip=True) == "skip"
    assert evaluator.respond(-60, -70, may_skip=False) != "skip"
    assert evaluator.respond(-60, -40, may_skip=True) != "skip"
    assert evaluator.respond(-50, -50, may_skip=True) != "skip"


@pytest.mark.parametrize("difference", [-30.0, 0.0, 10.0])
def test_the_uncertain_one_chooses_left_as_often_as_the_model_says(difference: float) -> None:
    evaluator = Uncertain(np.random.default_rng(1))
    n = 4000
    left = sum(evaluator.respond(difference, 0, may_skip=False) == "left" for _ in range(n))
    expected = 1 / (1 + np.exp(-ETA * difference))
    # Four standard deviations of a share of n.
    assert left / n == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / n))


def test_the_same_generator_gives_the_same_answers() -> None:
    one, two = (Uncertain(np.random.default_rng(3)) for _ in range(2))
    answers = [
        [evaluator.respond(-10, -12, may_skip=True) for _ in range(50)] for evaluator in (one, two)
    ]
    assert answers[0] == answers[1]
