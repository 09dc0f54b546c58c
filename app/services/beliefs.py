"""What a trial's model believes after some answers: worked out from them when somebody looks."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.pbbo import FitError, PreferenceOptimizer, has_posterior
from app.pbbo import Settings as OptimizerSettings

from .thoughts import History

#: Beliefs kept: those of a page of trials, for each of some readers. Some kilobytes each.
KEPT: Final = 128

#: Posterior mean and deviation, each (n,).
Belief = tuple[NDArray[np.float64], NDArray[np.float64]]


class Beliefs:
    """Works beliefs out and keeps the last ones, by the trial's seed and what was answered."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[int, History], Belief | None] = OrderedDict()
        self._forgotten: set[int] = set()

    def after(
        self,
        candidates: NDArray[np.float64],
        method: str,
        settings: Mapping[str, Any],
        seed: int,
        history: History,
    ) -> Belief | None:
        """The posterior over the candidates, (n, d); None where no model is, or none can be fit.

        A fit takes up to some tenths of a second: not for the event loop.
        """
        if not has_posterior(method) or not history:
            return None
        key = (seed, history)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        optimizer = PreferenceOptimizer.replay(
            candidates,
            history,
            method=method,
            seed=seed,
            settings=OptimizerSettings.from_mapping(settings),
        )
        try:
            belief: Belief | None = optimizer.posterior()
        except FitError:
            belief = None
        with self._lock:
            if seed not in self._forgotten:
                self._kept[key] = belief
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return belief

    def forget(self, seeds: frozenset[int]) -> None:
        """Forget the trials of these seeds: their histories were deleted."""
        with self._lock:
            self._forgotten |= seeds
        self.drop(seeds)

    def remembered(self) -> frozenset[int]:
        """The seeds of all trials that a belief is kept of."""
        with self._lock:
            return frozenset(seed for seed, _ in self._kept)

    def drop(self, seeds: frozenset[int]) -> None:
        """Throw away what is kept of these trials; what is asked for is worked out again."""
        with self._lock:
            for key in [key for key in self._kept if key[0] in seeds]:
                del self._kept[key]
