"""Computes steps of shared models, and keeps those that were computed ahead for open queries."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final, Protocol

from cachetools import LRUCache

from app.services.background.interface import Background
from app.services.runtime.metrics import Metrics

from .computation import FitProcess
from .shared_steps import (
    RememberedFits,
    SharedRequest,
    SharedStep,
    compute_shared_step,
    forget_in_child,
    step_in_child,
)
from .step_cache import MAX_PURGED

#: Open queries whose steps are kept. Each holds the answers that it was computed from.
MAX_PREPARED: Final = 1_000


class Prepared(Protocol):
    """Steps that were computed for one place of a trial. seeds: of all trials they learnt from."""

    @property
    def seeds(self) -> frozenset[int]: ...


class SharedProposer:
    """Steps of shared models. Thread-safe.

    fit_process: the child process in which steps are computed once it is ready.
    """

    def __init__(self, fit_process: FitProcess, background: Background, metrics: Metrics) -> None:
        self._fit_process = fit_process
        self._background = background
        self._metrics = metrics
        self._lock = threading.Lock()
        self._fits = RememberedFits()
        self._prepared: LRUCache[tuple[int, int], Prepared] = LRUCache(MAX_PREPARED)
        # A computation that was running when a trial was deleted must not store its result.
        self._purged: LRUCache[int, None] = LRUCache(MAX_PURGED)

    def steps(
        self, requests: Sequence[SharedRequest], *, starts_process: bool = True
    ) -> list[SharedStep]:
        """The steps of these requests, in order. Not within a transaction: fits models.

        starts_process: as for `BoxProposer.steps`.
        """
        trivial = all(not request.history for request in requests)
        here = trivial or not (starts_process or self._fit_process.is_ready)
        with self._metrics.fitting(len(requests)):
            if here:
                return [self.step(request) for request in requests]
            return self._fit_process.map(step_in_child, requests)

    def step(self, request: SharedRequest) -> SharedStep:
        """The step of this request, computed in the calling thread."""
        return compute_shared_step(request, self._fits)

    def prepared(self, seed: int, place: int) -> Prepared | None:
        """What was kept for the query at this index of the trial of this seed."""
        with self._lock:
            return self._prepared.get((seed, place))

    def prepare(self, seed: int, place: int, prepared: Prepared) -> None:
        """Keep this for the query at this index. Ignored if a trial in it has been deleted."""
        with self._lock:
            if not any(one in self._purged for one in (seed, *prepared.seeds)):
                self._prepared[seed, place] = prepared

    def seeds(self) -> frozenset[int]:
        """The seeds of all trials that something is kept of.

        What is kept for a first query is of other trials; its own may not have begun.
        """
        with self._lock:
            own = (seed for seed, place in self._prepared if place > 0)
            return frozenset(own).union(*(one.seeds for one in self._prepared.values()))

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop all that these trials have a part in, and remembered fits; they may come again."""
        with self._lock:
            gone = [
                key
                for key, prepared in self._prepared.items()
                if key[0] in seeds or not seeds.isdisjoint(prepared.seeds)
            ]
            for key in gone:
                del self._prepared[key]
        if gone:
            self._fits.forget()
            if self._fit_process.is_ready:
                self._background.in_thread(
                    "forget fits", self._fit_process.map, forget_in_child, [None]
                )

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop the same of these deleted trials, and keep nothing more of them."""
        with self._lock:
            self._purged.update(dict.fromkeys(seeds))
        self.evict(seeds)
