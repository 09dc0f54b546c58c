"""What is kept of what was worked out ahead."""

from __future__ import annotations

import pytest

from app.services import foreseen
from app.services.foreseen import Foreseen
from app.services.thoughts import History

Kept = Foreseen[str]

FIRST: History = ()
LEFT: History = ((0, 1, "left"),)
RIGHT: History = ((0, 1, "right"),)
LATER: History = (*LEFT, (2, 3, "skip"))


@pytest.fixture
def kept() -> Kept:
    return Kept()


def test_what_was_told_is_known_and_nothing_else(kept: Kept) -> None:
    kept.tell(7, {LEFT: "after left", RIGHT: "after right"})
    assert kept.after(7, [RIGHT, LATER, LEFT, FIRST]) == ["after right", None, "after left", None]
    assert kept.after(8, [LEFT]) == [None]
    assert kept.seeds() == {7}


def test_what_follows_fewer_answers_goes_when_a_trial_goes_on(kept: Kept) -> None:
    assert kept.stands_at(7) is None
    kept.tell(7, {FIRST: "first", LEFT: "after left", LATER: "later"})
    kept.go_on(7, 1)
    assert kept.stands_at(7) == 1
    assert kept.after(7, [FIRST, LEFT, LATER]) == [None, "after left", "later"]
    kept.tell(7, {RIGHT: "after right"})
    assert kept.stands_at(7) == 1
    kept.go_on(7, 0)  # a response was taken back
    assert kept.stands_at(7) == 0
    assert kept.after(7, [LEFT, RIGHT]) == ["after left", "after right"]


def test_what_is_forgotten_is_not_brought_back_by_work_under_way(kept: Kept) -> None:
    for seed in (7, 8):
        kept.go_on(seed, 1)
        kept.tell(seed, {LEFT: "after left"})
    kept.forget(frozenset({7}))
    kept.tell(7, {LEFT: "after left"})
    kept.go_on(7, 2)
    assert kept.seeds() == {8}
    assert kept.after(7, [LEFT]) == [None]
    assert kept.stands_at(7) is None


def test_what_is_dropped_may_be_told_again(kept: Kept) -> None:
    kept.tell(7, {LEFT: "after left"})
    kept.drop(frozenset({7, 9}))
    assert kept.after(7, [LEFT]) == [None]
    kept.tell(7, {LEFT: "after left"})
    assert kept.after(7, [LEFT]) == ["after left"]


def test_of_many_trials_those_seen_last_are_kept(
    kept: Kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreseen, "KEPT", 2)
    for seed, answers in ((1, 0), (2, 0), (1, 1), (3, 0)):
        kept.go_on(seed, answers)
    assert kept.seeds() == {1, 3}
