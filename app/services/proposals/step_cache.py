"""LRU cache of precomputed next steps, by the trial's seed and history. Thread-safe.

Each process has its own. A step that another process has computed is computed again: some 5 to
20 ms, where a file that processes share would have to be waited for.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from cachetools import LRUCache

from .computation import History

T = TypeVar("T")

#: Cached trials: more than one server has evaluators at any time.
MAX_TRIALS: Final = 2_000
#: Deleted trials that are remembered: far more than are deleted while one computation runs.
MAX_PURGED: Final = 10_000


@dataclass
class _Trial(Generic[T]):
    answers: int = 0
    steps: dict[History, T] = field(default_factory=dict)


class StepCache(Generic[T]):
    """Steps by trial seed and history, for the most recently used trials."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._trials: LRUCache[int, _Trial[T]] = LRUCache(MAX_TRIALS)
        # A computation that was running when its trial was deleted must not store its result.
        self._purged: LRUCache[int, None] = LRUCache(MAX_PURGED)

    def get(self, seed: int, histories: Sequence[History]) -> list[T | None]:
        """The step after each of these histories, in order; None for those that are not cached."""
        with self._lock:
            trial = self._trials.get(seed)
            return [None if trial is None else trial.steps.get(history) for history in histories]

    def put(self, seed: int, steps: Mapping[History, T]) -> None:
        """Cache these steps atomically. Ignored for a purged trial."""
        with self._lock:
            if seed not in self._purged:
                self._trial(seed).steps.update(steps)

    def advance(self, seed: int, answers: int) -> None:
        """Set the trial's number of answers, and drop the steps after shorter histories."""
        with self._lock:
            if seed not in self._purged:
                trial = self._trial(seed)
                trial.answers = answers
                for history in [one for one in trial.steps if len(one) < answers]:
                    del trial.steps[history]

    def position(self, seed: int) -> int | None:
        """The number of answers at the last `advance`; None if the trial is not cached."""
        with self._lock:
            trial = self._trials.get(seed)
            return None if trial is None else trial.answers

    def seeds(self) -> frozenset[int]:
        """The seeds of all cached trials."""
        with self._lock:
            return frozenset(self._trials)

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop the steps of these trials; they may be cached again."""
        with self._lock:
            for seed in seeds:
                self._trials.pop(seed, None)

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop the steps of these deleted trials, and ignore further ones."""
        with self._lock:
            self._purged.update(dict.fromkeys(seeds))
        self.evict(seeds)

    def _trial(self, seed: int) -> _Trial[T]:
        trial = self._trials.get(seed)
        if trial is None:
            trial = self._trials[seed] = _Trial()
        return trial
