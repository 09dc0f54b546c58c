"""LRU cache of posteriors over the candidates, filled on demand by session pages. Thread-safe."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from app.pbbo import FitError, PreferenceOptimizer, has_posterior
from app.pbbo import Settings as OptimizerSettings

from .computation import History
from .step_cache import MAX_PURGED

#: Cached posteriors, some kilobytes each: enough for the finished trials of a results page.
MAX_POSTERIORS: Final = 2048

#: Posterior mean and standard deviation, each (n,).
Posterior = tuple[NDArray[np.float64], NDArray[np.float64]]


class PosteriorCache:
    """Posteriors by the trial's seed and its history."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._posteriors: LRUCache[tuple[int, History], Posterior | None] = LRUCache(MAX_POSTERIORS)
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
        the fit fails. A fit takes up to some tenths of a second: do not call it on the event loop.
        """
        if not has_posterior(method) or not history:
            return None
        key = (seed, history)
        with self._lock:
            if key in self._posteriors:
                return self._posteriors[key]
        optimizer = PreferenceOptimizer.replay(
            candidates,
            history,
            method=method,
            seed=seed,
            settings=OptimizerSettings.from_mapping(settings),
        )
        try:
            posterior: Posterior | None = optimizer.posterior()
        except FitError:
            posterior = None
        with self._lock:
            if seed not in self._purged:
                self._posteriors[key] = posterior
        return posterior

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
