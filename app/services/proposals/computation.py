"""What the optimiser thinks after a history, here or in a process of its own.

What is worked out ahead is worked out elsewhere: a fit is some milliseconds in which this process
could answer nobody else.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from app.pbbo import FitError, Preference, PreferenceOptimizer, Query, Settings, has_posterior
from app.services.runtime.child_process import set_up_child_process

#: One answered query: left candidate, right candidate, "left" | "right" | "skip", and of a skip the
#: reason where the method learns from it.
Answer = tuple[int, int, str] | tuple[int, int, str, str | None]
History = tuple[Answer, ...]


@dataclass(frozen=True)
class StepRequest:
    """All that a thought follows from. candidates: (n, d). ends: whether no query is wanted."""

    candidates: NDArray[np.float64]
    method: str
    settings: Mapping[str, Any]
    seed: int
    history: History
    ends: bool


@dataclass(frozen=True)
class AcquiredCandidate:
    """w_acq after a response; a knockout has no posterior."""

    candidate: int
    mean: float | None
    std: float | None


@dataclass(frozen=True)
class StepResult:
    """The next query (None where none is wanted), and what was learnt.

    likelier: the side that the model expects to win.
    """

    query: Query | None
    likelier: str
    preferences: tuple[Preference, ...]
    acquired: AcquiredCandidate | None


def compute_step(request: StepRequest) -> StepResult:
    """The thought that follows, from nothing but the question."""
    optimizer = PreferenceOptimizer.replay(
        request.candidates,
        request.history,
        method=request.method,
        seed=request.seed,
        settings=Settings.from_mapping(request.settings),
    )
    query = None if request.ends else optimizer.ask()
    return StepResult(
        query=query,
        likelier="left" if query is None else _likelier(optimizer, request.method, query),
        preferences=optimizer.preferences,
        acquired=_acquired(optimizer, request.method) if request.history else None,
    )


def compute_steps(requests: Sequence[StepRequest]) -> list[StepResult]:
    """The thoughts that follow from these, in their order."""
    return [compute_step(request) for request in requests]


class FitProcess:
    """Thinks in a process of its own, which is started when it is first needed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        #: Whether the process is there: it has answered before.
        self.is_ready = False

    def compute_steps(self, requests: Sequence[StepRequest]) -> list[StepResult]:
        """As `compute_step` of each; this process waits meanwhile, and can do other things.

        They go there together: each errand takes this process about a millisecond.
        """
        try:
            results = self._open().submit(compute_steps, requests).result()
        except BrokenProcessPool:
            # It was killed, for want of memory say: the next one starts afresh.
            self.close()
            results = self._open().submit(compute_steps, requests).result()
        self.is_ready = True
        return results

    def close(self) -> None:
        with self._lock:
            pool, self._pool = self._pool, None
            self.is_ready = False
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)

    def _open(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._pool is None:
                self._pool = ProcessPoolExecutor(
                    1,
                    # A fork would copy the server's locks in whatever state they are.
                    mp_context=multiprocessing.get_context("spawn"),
                    initializer=_begin,
                )
            return self._pool


def _begin() -> None:
    # Not by much: what is not thought in time is asked for again and again, which costs pages more.
    set_up_child_process(yields=5)
    # As in the server: one fit, one processor.
    threadpool_limits(1, user_api="blas")


def _likelier(optimizer: PreferenceOptimizer, method: str, query: Query) -> str:
    posterior = _posterior(optimizer, method) if query.trial_type == "model" else None
    if posterior is None:
        return "left"
    mean, _ = posterior
    return "left" if mean[query.left] >= mean[query.right] else "right"


def _acquired(optimizer: PreferenceOptimizer, method: str) -> AcquiredCandidate:
    best = optimizer.best()
    posterior = _posterior(optimizer, method)
    if posterior is None:
        return AcquiredCandidate(best, None, None)
    mean, std = posterior
    return AcquiredCandidate(best, float(mean[best]), float(std[best]))


def _posterior(
    optimizer: PreferenceOptimizer, method: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Mean and deviation over the candidates; None where there is no model, or none can be fit."""
    if not has_posterior(method):
        return None
    try:
        return optimizer.posterior()
    except FitError:
        return None
