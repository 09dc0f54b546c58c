"""Computes and caches steps over search spaces given by ranges, on request or in advance."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Sequence
from typing import Final

from cachetools import LRUCache

from app.services.runtime.metrics import Metrics

from .box_steps import BoxRequest, BoxStep, compute_box_step
from .computation import FitProcess
from .step_cache import MAX_PURGED

#: Cached steps, a few kilobytes each: the open query and its three futures of 1,000 sessions.
MAX_STEPS: Final = 4_000
#: Open queries for which this process has prepared what may follow.
MAX_PREPARED: Final = 10_000


class BoxProposer:
    """Steps by request. Thread-safe.

    fit_process: the child process in which steps are computed once it is ready.
    """

    def __init__(self, fit_process: FitProcess, metrics: Metrics) -> None:
        self._fit_process = fit_process
        self._metrics = metrics
        self._lock = threading.Lock()
        self._steps: LRUCache[BoxRequest, BoxStep] = LRUCache(MAX_STEPS)
        self._prepared: LRUCache[str, int] = LRUCache(MAX_PREPARED)
        # A computation that was running when its trial was deleted must not store its result.
        self._purged: LRUCache[int, None] = LRUCache(MAX_PURGED)

    def step(self, request: BoxRequest) -> BoxStep:
        """The step of this request: from the cache if it is there, otherwise computed now."""
        [step] = self.steps([request], starts_process=False)
        return step

    def steps(
        self, requests: Sequence[BoxRequest], *, starts_process: bool = True
    ) -> list[BoxStep]:
        """The steps of these requests, in order.

        starts_process: whether to start the child process if it is not ready, instead of computing
        in this one. Not for what a person waits for: a start takes longer than a fit.
        """
        with self._lock:
            known: dict[BoxRequest, BoxStep | None] = {
                request: self._steps.get(request) for request in requests
            }
        missing = [request for request, step in known.items() if step is None]
        if missing:
            trivial = all(not request.history for request in missing)
            here = trivial or not (starts_process or self._fit_process.is_ready)
            with self._metrics.fitting(len(missing)):
                computed = (
                    [compute_box_step(request) for request in missing]
                    if here
                    else self._fit_process.map(compute_box_step, missing)
                )
            with self._lock:
                for request, step in zip(missing, computed, strict=True):
                    known[request] = step
                    if request.seed not in self._purged:
                        self._steps[request] = step
        return [found for request in requests if (found := known[request]) is not None]

    def cached(self, request: BoxRequest) -> BoxStep | None:
        """The step of this request if it is cached, otherwise None."""
        with self._lock:
            return self._steps.get(request)

    def is_prepared(self, query_id: str, possible: Hashable) -> bool:
        """Whether `mark_prepared` was called last with these arguments."""
        with self._lock:
            return self._prepared.get(query_id) == hash(possible)

    def mark_prepared(self, query_id: str, possible: Hashable) -> None:
        """Remember that recordings were asked for what may follow this query."""
        with self._lock:
            self._prepared[query_id] = hash(possible)

    def seeds(self) -> frozenset[int]:
        """The seeds of all trials with a cached step."""
        with self._lock:
            return frozenset(request.seed for request in self._steps)

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop the steps of these trials; they may be cached again."""
        with self._lock:
            for request in [request for request in self._steps if request.seed in seeds]:
                del self._steps[request]

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop the steps of these deleted trials, and cache nothing more for them."""
        with self._lock:
            self._purged.update(dict.fromkeys(seeds))
        self.evict(seeds)
