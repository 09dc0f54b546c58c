"""The cache of precomputed steps."""

from __future__ import annotations

import pytest

from app.services.proposals import step_cache
from app.services.proposals.computation import History
from app.services.proposals.step_cache import StepCache

Cache = StepCache[str]

FIRST: History = ()
LEFT: History = ((0, 1, "left"),)
RIGHT: History = ((0, 1, "right"),)
LATER: History = (*LEFT, (2, 3, "skip"))


@pytest.fixture
def cache() -> Cache:
    return Cache()


def test_what_was_told_is_known_and_nothing_else(cache: Cache) -> None:
    cache.put(7, {LEFT: "after left", RIGHT: "after right"})
    assert cache.get(7, [RIGHT, LATER, LEFT, FIRST]) == ["after right", None, "after left", None]
    assert cache.get(8, [LEFT]) == [None]
    assert cache.seeds() == {7}


def test_what_follows_fewer_answers_goes_when_a_trial_goes_on(cache: Cache) -> None:
    assert cache.position(7) is None
    cache.put(7, {FIRST: "first", LEFT: "after left", LATER: "later"})
    cache.advance(7, 1)
    assert cache.position(7) == 1
    assert cache.get(7, [FIRST, LEFT, LATER]) == [None, "after left", "later"]
    cache.put(7, {RIGHT: "after right"})
    assert cache.position(7) == 1
    cache.advance(7, 0)  # a response was taken back
    assert cache.position(7) == 0
    assert cache.get(7, [LEFT, RIGHT]) == ["after left", "after right"]


def test_what_is_forgotten_is_not_brought_back_by_work_under_way(cache: Cache) -> None:
    for seed in (7, 8):
        cache.advance(seed, 1)
        cache.put(seed, {LEFT: "after left"})
    cache.purge(frozenset({7}))
    cache.put(7, {LEFT: "after left"})
    cache.advance(7, 2)
    assert cache.seeds() == {8}
    assert cache.get(7, [LEFT]) == [None]
    assert cache.position(7) is None


def test_what_is_dropped_may_be_told_again(cache: Cache) -> None:
    cache.put(7, {LEFT: "after left"})
    cache.evict(frozenset({7, 9}))
    assert cache.get(7, [LEFT]) == [None]
    cache.put(7, {LEFT: "after left"})
    assert cache.get(7, [LEFT]) == ["after left"]


def test_of_many_trials_those_used_last_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_cache, "MAX_TRIALS", 2)
    cache = Cache()
    for seed, answers in ((1, 0), (2, 0), (1, 1), (3, 0)):
        cache.advance(seed, answers)
    assert cache.seeds() == {1, 3}


def test_of_many_deleted_trials_the_last_ones_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_cache, "MAX_PURGED", 2)
    cache = Cache()
    for seed in (1, 2, 3):
        cache.purge(frozenset({seed}))
    for seed in (1, 2, 3):
        cache.put(seed, {LEFT: "after left"})
    assert cache.seeds() == {1}
