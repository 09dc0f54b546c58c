"""LRU caches of what trials' models believe, filled on demand by session pages. Thread-safe."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from app.pbbo import FitError, PreferenceOptimizer, has_posterior
from app.pbbo import Settings as OptimizerSettings

from .box_steps import BoxRequest, Point, optimizer_of
from .computation import History
from .step_cache import MAX_PURGED

#: Cached posteriors, some kilobytes each: enough for the finished trials of a results page.
MAX_POSTERIORS: Final = 2048

#: The share of a belief that the set of candidates that may be best holds.
PROBABILITY: Final = 0.95

#: Posterior mean and standard deviation, each (n,).
Posterior = tuple[NDArray[np.float64], NDArray[np.float64]]

Key = tuple[int, Hashable]
T = TypeVar("T")


@dataclass(frozen=True)
class BoxBelief:
    """What a trial over a search space believes.

    mean, std: at the points that were asked about, each (n,). may_be_best: (k, d), points of which
    the best is one with probability PROBABILITY, likeliest first.
    """

    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    may_be_best: NDArray[np.float64]


class PosteriorCache:
    """Posteriors by the trial's seed and its history.

    A fit takes up to some tenths of a second: do not call these on the event loop.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._posteriors: LRUCache[Key, Any] = LRUCache(MAX_POSTERIORS)
        # A fit that was running when its trial was deleted must not store its result.
        self._purged: LRUCache[int, None] = LRUCache(MAX_PURGED)

    def posterior(
        self,
        candidates: NDArray[np.float64],
        method: str,
        settings: Mapping[str, Any],
        seed: int,
        history: History,
    ) -> Posterior | None:
        """Posterior mean and standard deviation over the candidates, each (n,).

        candidates: (n, d). Returns None for an empty history, for a method without a model, and if
        the fit fails.
        """
        if not has_posterior(method) or not history:
            return None

        def compute() -> Posterior:
            return _replayed(candidates, method, settings, seed, history).posterior()

        return self._kept((seed, ("posterior", history)), compute)

    def may_be_best(
        self,
        candidates: NDArray[np.float64],
        method: str,
        settings: Mapping[str, Any],
        seed: int,
        history: History,
    ) -> tuple[int, ...] | None:
        """The fewest candidates of which the best is one with probability PROBABILITY.

        Likeliest first. Returns None in the same cases as `posterior`.
        """
        if not has_posterior(method) or not history:
            return None

        def compute() -> tuple[int, ...]:
            optimizer = _replayed(candidates, method, settings, seed, history)
            return optimizer.may_be_best(PROBABILITY)

        return self._kept((seed, ("may be best", history)), compute)

    def over_space(self, request: BoxRequest, points: Sequence[Point]) -> BoxBelief | None:
        """What a trial over a search space believes, also of these points; None if the fit fails.

        request: one whose history is the trial's. points: in the parameters' own units.
        """
        if not request.history:
            return None

        def compute() -> BoxBelief:
            optimizer = optimizer_of(request)
            mean, std = optimizer.posterior(points)
            return BoxBelief(mean, std, optimizer.may_be_best(PROBABILITY))

        return self._kept((request.seed, (request, tuple(points))), compute)

    def _kept(self, key: Key, compute: Callable[[], T]) -> T | None:
        """The cached value of this key, otherwise the computed one; None if the fit fails."""
        with self._lock:
            if key in self._posteriors:
                kept: T | None = self._posteriors[key]
                return kept
        try:
            value: T | None = compute()
        except FitError:
            value = None
        with self._lock:
            if key[0] not in self._purged:
                self._posteriors[key] = value
        return value

    def seeds(self) -> frozenset[int]:
        """The seeds of all trials with a cached posterior."""
        with self._lock:
            return frozenset(seed for seed, _ in self._posteriors)

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop the posteriors of these trials; they may be cached again."""
        with self._lock:
            for key in [key for key in self._posteriors if key[0] in seeds]:
                del self._posteriors[key]

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop the posteriors of these deleted trials, and refuse further ones."""
        with self._lock:
            self._purged.update(dict.fromkeys(seeds))
        self.evict(seeds)


def _replayed(
    candidates: NDArray[np.float64],
    method: str,
    settings: Mapping[str, Any],
    seed: int,
    history: History,
) -> PreferenceOptimizer:
    return PreferenceOptimizer.replay(
        candidates,
        history,
        method=method,
        seed=seed,
        settings=OptimizerSettings.from_mapping(settings),
    )
