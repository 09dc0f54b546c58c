"""Evaluators who answer from the scores of the two runs they are shown."""

from __future__ import annotations

import numpy as np
import pytest

from app.lab.answering import EVALUATORS
from app.lab.evaluators import ETA, Certain, Discerning, Lapsing, LeftAtFirst, Uncertain
from app.lab.problems import PROBLEMS


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


def test_a_lapse_is_a_coin_toss_and_never_a_skip() -> None:
    rng = np.random.default_rng(0)
    evaluator = Lapsing(rng, Certain(skip_below=0.0), 0.2)

    better_left = [evaluator.respond(2.0, 1.0, may_skip=True) for _ in range(4000)]
    both_bad = [evaluator.respond(-1.0, -2.0, may_skip=True) for _ in range(4000)]

    assert better_left.count("right") / 4000 == pytest.approx(0.1, abs=0.02)
    assert both_bad.count("skip") / 4000 == pytest.approx(0.8, abs=0.02)


def test_an_evaluator_who_does_not_look_at_first_answers_left_until_then() -> None:
    evaluator = LeftAtFirst(Certain(skip_below=0.0), 5)

    answers = [evaluator.respond(1.0, 2.0, may_skip=True) for _ in range(7)]

    assert answers == ["left"] * 5 + ["right"] * 2


def test_every_named_evaluator_skips_at_its_own_level() -> None:
    problem = PROBLEMS["branin"]()
    rng = np.random.default_rng(3)

    made = {name: make(problem, rng) for name, make in EVALUATORS.items()}

    just_below = problem.mean - 1e-6
    for name, skips in {"uncertain": True, "skip-low": False, "no-skip": False}.items():
        answered = made[name].respond(just_below, just_below, may_skip=True)
        assert (answered == "skip") is skips
    above = problem.mean + 0.5 * problem.deviation
    assert made["skip-high"].respond(above, above, may_skip=True) == "skip"


def test_one_who_cannot_tell_says_so_and_of_two_bad_runs_that_they_are_bad() -> None:
    rng = np.random.default_rng(0)
    evaluator = Discerning(Uncertain(rng, skip_below=0.0), noticeable=5.0)

    said = [
        (evaluator.respond(left, right, may_skip=True), evaluator.reason)
        for left, right in ((20.0, 16.0), (-3.0, -2.0), (900.0, 1.0))
    ]

    assert said == [("skip", "cannot_tell"), ("skip", "both_bad"), ("left", None)]
    assert evaluator.respond(20.0, 16.0, may_skip=False) != "skip"
