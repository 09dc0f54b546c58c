"""Steps worked out ahead, by the trial's seed and history: in memory, the trials seen last.

Each process keeps its own. A step that another process has worked out is worked out again: some
5 to 20 ms, where a file that processes share would have to be waited for.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from .thoughts import History

T = TypeVar("T")

#: Trials that something is kept of: more than a server's evaluators at any time.
KEPT: Final = 2_000


@dataclass
class _Trial(Generic[T]):
    answers: int = 0
    after: dict[History, T] = field(default_factory=dict)


class Foreseen(Generic[T]):
    """What follows each history, by the trial's seed. Any thread may ask and tell."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._trials: OrderedDict[int, _Trial[T]] = OrderedDict()
        # Trials whose person had them deleted: work that is under way must not bring them back.
        self._forgotten: set[int] = set()

    def after(self, seed: int, histories: Sequence[History]) -> list[T | None]:
        """What follows each of these, as far as it is known."""
        with self._lock:
            trial = self._trials.get(seed)
            return [None if trial is None else trial.after.get(history) for history in histories]

    def tell(self, seed: int, found: Mapping[History, T]) -> None:
        """Keep what follows these, all at once."""
        with self._lock:
            if seed not in self._forgotten:
                self._trial(seed).after.update(found)

    def go_on(self, seed: int, answers: int) -> None:
        """The trial has come to so many answers: what follows fewer is not asked for again."""
        with self._lock:
            if seed not in self._forgotten:
                trial = self._trial(seed)
                trial.answers = answers
                for history in [one for one in trial.after if len(one) < answers]:
                    del trial.after[history]

    def stands_at(self, seed: int) -> int | None:
        """How many answers the trial had when it was last seen."""
        with self._lock:
            trial = self._trials.get(seed)
            return None if trial is None else trial.answers

    def seeds(self) -> frozenset[int]:
        """All trials that anything is kept of."""
        with self._lock:
            return frozenset(self._trials)

    def drop(self, seeds: frozenset[int]) -> None:
        """Throw away what is kept of these trials."""
        with self._lock:
            for seed in seeds:
                self._trials.pop(seed, None)

    def forget(self, seeds: frozenset[int]) -> None:
        """The same, for good."""
        with self._lock:
            self._forgotten |= seeds
        self.drop(seeds)

    def _trial(self, seed: int) -> _Trial[T]:
        trial = self._trials.setdefault(seed, _Trial())
        self._trials.move_to_end(seed)
        while len(self._trials) > KEPT:
            self._trials.popitem(last=False)
        return trial
