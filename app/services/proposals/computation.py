"""Computes optimiser steps: replays a history, fits the model, and proposes the next query.

`compute_step` is pure. `FitProcess` runs it in a child process, because a fit takes some
milliseconds of CPU time during which the server could answer no request.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from app.pbbo import FitError, Preference, PreferenceOptimizer, Query, Settings, has_posterior
from app.services.runtime.child_process import child_context, set_up_child_process

T = TypeVar("T")
R = TypeVar("R")

#: One answered query: left candidate, right candidate, "left" | "right" | "skip", and the reason of
#: a skip if the method learns from reasons.
Answer = tuple[int, int, str] | tuple[int, int, str, str | None]
History = tuple[Answer, ...]


@dataclass(frozen=True)
class StepRequest:
    """The input of one step.

    candidates: (n, d). history: the answered queries, oldest first. ends: whether the history is
    complete, so that no further query is proposed. within: what to be sure of, as for
    `PreferenceOptimizer.sureness`; None to leave that out.
    """

    candidates: NDArray[np.float64]
    method: str
    settings: Mapping[str, Any]
    seed: int
    history: History
    ends: bool
    within: float | None = None


@dataclass(frozen=True)
class AcquiredCandidate:
    """w_acq after a response: the candidate's index, and its posterior mean and deviation.

    mean, std: None if the method has no model (knockout) or the model could not be fitted.
    sureness: the probability that no candidate is better by more than the request's `within`; None
    in the same cases, or if it was not asked for.
    """

    candidate: int
    mean: float | None
    std: float | None
    sureness: float | None = None


@dataclass(frozen=True)
class StepResult:
    """The output of one step: the next query and the rows derived from the history.

    query: None if the request's history was complete. likelier: the side with the larger posterior
    mean. acquired: None after an empty history.
    """

    query: Query | None
    likelier: str
    preferences: tuple[Preference, ...]
    acquired: AcquiredCandidate | None


def compute_step(request: StepRequest) -> StepResult:
    """Compute the next query, the preferences and the acquired candidate of one history. Pure."""
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
        acquired=_acquired(optimizer, request) if request.history else None,
    )


def compute_steps(requests: Sequence[StepRequest]) -> list[StepResult]:
    """Compute several steps, in the order of the requests."""
    return [compute_step(request) for request in requests]


class FitProcess:
    """A child process that computes steps. It is started at the first request. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        #: Whether the child process has started and returned a result.
        self.is_ready = False

    def compute_steps(self, requests: Sequence[StepRequest]) -> list[StepResult]:
        """Compute these steps in the child process; blocks the calling thread only."""
        return self.map(compute_step, requests)

    def map(self, compute: Callable[[T], R], requests: Sequence[T]) -> list[R]:
        """Apply `compute` to each request in the child process, in order.

        All requests are sent in one message, which costs this process about a millisecond. If the
        child was killed, it is started again once. compute: a function of a module.
        """
        try:
            results = self._open().submit(_compute_all, compute, requests).result()
        except BrokenProcessPool:
            # The child was killed, for example by the OOM killer.
            self.close()
            results = self._open().submit(_compute_all, compute, requests).result()
        self.is_ready = True
        return results

    def close(self) -> None:
        """Stop the child process; the next request starts another."""
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
                    mp_context=child_context(),
                    initializer=_begin,
                )
            return self._pool


def _compute_all(compute: Callable[[T], R], requests: Sequence[T]) -> list[R]:
    return [compute(request) for request in requests]


def _begin() -> None:
    # Less than for other workers: a late step is requested again with every poll.
    set_up_child_process(yields=5)
    # One processor per fit, as in the server.
    threadpool_limits(1, user_api="blas")


def _likelier(optimizer: PreferenceOptimizer, method: str, query: Query) -> str:
    posterior = _posterior(optimizer, method) if query.trial_type == "model" else None
    if posterior is None:
        return "left"
    mean, _ = posterior
    return "left" if mean[query.left] >= mean[query.right] else "right"


def _acquired(optimizer: PreferenceOptimizer, request: StepRequest) -> AcquiredCandidate:
    best = optimizer.best()
    posterior = _posterior(optimizer, request.method)
    if posterior is None:
        return AcquiredCandidate(best, None, None)
    mean, std = posterior
    sureness = None if request.within is None else optimizer.sureness(request.within)
    return AcquiredCandidate(best, float(mean[best]), float(std[best]), sureness)


def _posterior(
    optimizer: PreferenceOptimizer, method: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Posterior mean and standard deviation, each (n,); None if the method has no model or the fit
    fails.
    """
    if not has_posterior(method):
        return None
    try:
        return optimizer.posterior()
    except FitError:
        return None
