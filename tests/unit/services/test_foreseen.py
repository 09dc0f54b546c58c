"""What is kept of what was worked out ahead: in a process's memory, or in a file of several."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.services import foreseen, foreseen_together
from app.services.foreseen import Foreseen
from app.services.foreseen_together import ForeseenTogether
from app.services.thoughts import History

Kept = Foreseen[str] | ForeseenTogether[str]

FIRST: History = ()
LEFT: History = ((0, 1, "left"),)
RIGHT: History = ((0, 1, "right"),)
LATER: History = (*LEFT, (2, 3, "skip"))


@pytest.fixture(params=["in memory", "together"])
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Kept]:
    made: Kept = Foreseen() if request.param == "in memory" else ForeseenTogether(tmp_path / "kept")
    yield made
    made.close()


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
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(foreseen, "KEPT", 2)
    monkeypatch.setattr(foreseen_together, "KEPT", 2)
    for kept in (Foreseen[str](), ForeseenTogether[str](tmp_path / "kept")):
        for seed, answers in ((1, 0), (2, 0), (1, 1), (3, 0)):
            kept.go_on(seed, answers)
        assert kept.seeds() == {1, 3}
        kept.close()


@pytest.fixture
def two(tmp_path: Path) -> Iterator[tuple[ForeseenTogether[str], ForeseenTogether[str]]]:
    """As two processes have it."""
    one, other = (ForeseenTogether[str](tmp_path / "kept") for _ in range(2))
    yield one, other
    one.close()
    other.close()


def test_what_one_process_tells_another_knows(
    two: tuple[ForeseenTogether[str], ForeseenTogether[str]],
) -> None:
    one, other = two
    one.tell(7, {LEFT: "after left"})
    assert other.after(7, [LEFT, RIGHT]) == ["after left", None]
    other.go_on(7, 2)
    assert (one.stands_at(7), one.after(7, [LEFT])) == (2, [None])
    other.forget(frozenset({7}))
    one.tell(7, {LATER: "later"})
    assert one.seeds() == frozenset()


def test_what_was_forgotten_is_nowhere_in_the_file(tmp_path: Path) -> None:
    kept: ForeseenTogether[str] = ForeseenTogether(tmp_path / "kept")
    kept.tell(7, {LEFT: "what somebody thinks of it"})
    kept.forget(frozenset({7}))
    kept.close()
    assert not [file for file in tmp_path.iterdir() if b"somebody" in file.read_bytes()]


@pytest.mark.parametrize(
    "ask",
    [
        lambda kept: kept.after(7, [LEFT]) == [None],
        lambda kept: kept.stands_at(7) is None,
        lambda kept: kept.seeds() == frozenset(),
        lambda kept: kept.tell(7, {LEFT: "after left"}) is None,
        lambda kept: kept.go_on(7, 1) is None,
        lambda kept: kept.drop(frozenset({7})) is None,
    ],
)
def test_a_file_that_fails_costs_what_was_worked_out_ahead_and_no_more(
    ask: Callable[[ForeseenTogether[str]], bool], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept: ForeseenTogether[str] = ForeseenTogether(tmp_path / "kept")
    with sqlite3.connect(tmp_path / "kept") as file:
        file.execute("DROP TABLE steps")
        file.execute("DROP TABLE trials")
    file.close()
    assert ask(kept)
    assert "cannot be kept or found" in caplog.text
    kept.close()
