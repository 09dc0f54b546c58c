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

#: Trials with steps in the cache: more than a server's evaluators at any time.
MAX_TRIALS: Final = 2_000
#: Deleted trials that are refused: far more than are deleted while one computation runs.
MAX_PURGED: Final = 10_000


@dataclass
class _Trial(Generic[T]):
    answers: int = 0
    steps: dict[History, T] = field(default_factory=dict)


class StepCache(Generic[T]):
    """The step after each history of a trial, for the trials that were used last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._trials: LRUCache[int, _Trial[T]] = LRUCache(MAX_TRIALS)
        # A computation that is under way must not put a deleted trial back.
        self._purged: LRUCache[int, None] = LRUCache(MAX_PURGED)

    def get(self, seed: int, histories: Sequence[History]) -> list[T | None]:
        """The step after each of these histories; None where it is not cached."""
        with self._lock:
            trial = self._trials.get(seed)
            return [None if trial is None else trial.steps.get(history) for history in histories]

    def put(self, seed: int, steps: Mapping[History, T]) -> None:
        """Cache these steps, all at once."""
        with self._lock:
            if seed not in self._purged:
                self._trial(seed).steps.update(steps)

    def advance(self, seed: int, answers: int) -> None:
        """Note that the trial has this many answers, and drop the steps after fewer."""
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
        """Drop the steps of these deleted trials, and refuse further ones."""
        with self._lock:
            self._purged.update(dict.fromkeys(seeds))
        self.evict(seeds)

    def _trial(self, seed: int) -> _Trial[T]:
        trial = self._trials.get(seed)
        if trial is None:
            trial = self._trials[seed] = _Trial()
        return trial
