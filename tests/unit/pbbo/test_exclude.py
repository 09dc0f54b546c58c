"""Candidates of a list that must not be shown again."""

import numpy as np
import pytest

from app.pbbo import FitError, NoPosteriorError, PointError, PreferenceOptimizer
from app.pbbo.candidates import FloatArray

LINE: FloatArray = np.linspace(0.0, 1.0, 11)[:, None]
METHODS = ["pbpo", "pbpo-no-skip", "pbpo-no-synthesis", "pbpo-threshold", "knockout"]


def after(queries: int, method: str, *, excluded: tuple[int, ...] = ()) -> PreferenceOptimizer:
    """An optimiser whose evaluator likes large values; these candidates are excluded at first."""
    optimizer = PreferenceOptimizer(LINE, method, 3)
    for candidate in excluded:
        optimizer.exclude(candidate)
    for _ in range(queries):
        query = optimizer.ask()
        assert not {query.left, query.right} & set(excluded)
        optimizer.tell(query, "left" if query.left > query.right else "right")
    return optimizer


@pytest.mark.parametrize("method", METHODS)
def test_an_excluded_candidate_is_neither_proposed_nor_acquired(method: str) -> None:
    assert after(12, method).best() in (9, 10)

    without = after(12, method, excluded=(9, 10))

    assert without.best() not in (9, 10)
    assert without.best() >= 6


@pytest.mark.parametrize("method", METHODS)
def test_a_candidate_may_be_excluded_after_it_won(method: str) -> None:
    optimizer = after(9, method)
    best = optimizer.best()
    optimizer.exclude(best)
    assert optimizer.best() != best
    query = optimizer.ask()
    assert best not in (query.left, query.right)
    try:
        assert best not in optimizer.may_be_best()
    except NoPosteriorError:
        assert method == "knockout"


@pytest.mark.parametrize("method", METHODS)
def test_when_it_was_excluded_does_not_matter(method: str) -> None:
    early = after(8, method, excluded=(2, 5))
    history = []
    replayed = PreferenceOptimizer(LINE, method, 3)
    for candidate in (2, 5):
        replayed.exclude(candidate)
    for _ in range(8):
        query = replayed.ask()
        response = "left" if query.left > query.right else "right"
        history.append((query.left, query.right, response))
        replayed.tell(query, response)
    later = PreferenceOptimizer.replay(LINE, history, method=method, seed=3, excluded=[5, 2])

    assert later.ask() == early.ask()
    assert later.best() == early.best()


def test_a_query_that_waits_is_proposed_anew_if_the_candidate_is_in_it() -> None:
    optimizer = after(7, "pbpo-threshold")
    waiting = optimizer.ask()
    other = next(row for row in range(11) if row not in (waiting.left, waiting.right))
    optimizer.exclude(other)
    assert optimizer.ask() == waiting
    optimizer.exclude(waiting.left)
    assert waiting.left not in (optimizer.ask().left, optimizer.ask().right)


def test_the_threshold_learns_that_its_surroundings_are_bad() -> None:
    before, later = after(5, "pbpo-threshold"), after(5, "pbpo-threshold")
    later.exclude(4)
    assert later.posterior()[0][4] < before.posterior()[0][4]
    paper, same = after(5, "pbpo"), after(5, "pbpo")
    same.exclude(4)
    assert np.array_equal(same.posterior()[0], paper.posterior()[0])


def test_several_people_are_asked_without_it() -> None:
    optimizer = PreferenceOptimizer(LINE, "pbpo-threshold", 3)
    waiting = optimizer.ask("p1")
    optimizer.exclude(waiting.left)
    for person in ("p1", "p2", "p1", "p2"):
        query = optimizer.ask(person)
        assert waiting.left not in (query.left, query.right)
        optimizer.tell(query, "left" if query.left > query.right else "right", person=person)
    assert optimizer.best() != waiting.left


def test_two_candidates_have_to_be_left() -> None:
    optimizer = PreferenceOptimizer(LINE[:3], "pbpo-threshold")
    optimizer.exclude(1)
    optimizer.exclude(1)
    with pytest.raises(PointError, match=r"exclude: expected two candidates .*, got 1 of 3"):
        optimizer.exclude(0)
    query = optimizer.ask()
    assert {query.left, query.right} == {0, 2}


@pytest.mark.parametrize("candidate", [-1, 11, 1.5, "1", None, True, [1]])
def test_no_candidate_of_the_list_is_refused(candidate: object) -> None:
    with pytest.raises(PointError, match=r"exclude: expected a candidate from 0 to 10, got"):
        PreferenceOptimizer(LINE).exclude(candidate)


def test_without_a_fit_the_winner_is_none_that_is_excluded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    optimizer = after(6, "pbpo")
    optimizer.exclude(10)

    def fails(*_: object) -> None:
        raise FitError("no fit")

    monkeypatch.setattr("app.pbbo.model.belief_over", fails)
    assert optimizer.best() != 10
