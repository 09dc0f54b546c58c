"""Steps of a model that several people share: pairs for one of them, and the acquired candidate.

A step is a pure function of the candidates, the settings, the seed, everybody's answers and the
pairs that others are looking at. Many steps begin from the same full fit, so fits are
remembered: by the server's proposer for what it computes itself, by the child process for the rest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from threading import Lock
from typing import Any, Final, Literal

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from app.pbbo import FitError, PeopleSettings, PreferenceOptimizer, Query, Settings

from .computation import AcquiredCandidate

#: The one method that knows several people.
METHOD: Final = "pbpo-threshold"
#: Full fits that are remembered for each list of candidates with its settings; and such lists.
MAX_FITS: Final = 16
MAX_LISTS: Final = 8

#: The steps after each possible answer of one person begin from the same fit.
_PEOPLE: Final = PeopleSettings(unsettled=1)

Pair = tuple[int, int]
#: One answer: left, right, "left" | "right" | "skip", the reason of a skip, and who gave it.
PersonsAnswer = tuple[int, int, str, str | None, str]


@dataclass(frozen=True)
class SharedRequest:
    """The input of one step.

    candidates: (n, d). history: everybody's answers, oldest first; people are named by any text.
    person: who will answer. avoided: pairs that others are looking at. target: whose best candidate
    is looked for and acquired. choices: how many pairs are proposed, each for the case that those
    before it are being judged by another person. acquires: whether the acquired candidate is
    computed. within: what to be sure of, as for `PreferenceOptimizer.sureness`; None to leave that
    out.
    """

    candidates: NDArray[np.float64] = field(repr=False)
    settings: Mapping[str, Any]
    seed: int
    history: tuple[PersonsAnswer, ...] = field(repr=False)
    person: str
    avoided: tuple[Pair, ...]
    target: Literal["population", "person"]
    choices: int
    acquires: bool = True
    within: float | None = None


@dataclass(frozen=True)
class Choice:
    """A pair to compare. likelier: the side that the model expects to win."""

    query: Query
    likelier: str


@dataclass(frozen=True)
class SharedStep:
    """The output of one step. acquired: None after an empty history."""

    choices: tuple[Choice, ...]
    acquired: AcquiredCandidate | None


class RememberedFits:
    """Full fits by candidates and settings. Thread-safe."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._fits: LRUCache[str, LRUCache[Any, Any]] = LRUCache(MAX_LISTS)

    def of(self, request: SharedRequest) -> LRUCache[Any, Any]:
        """The fits of this request's candidates under its settings."""
        said = json.dumps(request.settings, sort_keys=True, default=str).encode()
        key = sha256(said + request.candidates.tobytes()).hexdigest()
        with self._lock:
            fits = self._fits.get(key)
            if fits is None:
                fits = self._fits[key] = LRUCache(MAX_FITS)
            return fits

    def forget(self) -> None:
        """Drop all; they are computed again on request."""
        with self._lock:
            self._fits.clear()


def compute_shared_step(request: SharedRequest, remembered: RememberedFits) -> SharedStep:
    """Compute one step. Pure: what is remembered only saves time."""
    settings = Settings.from_mapping(request.settings)
    optimizer = PreferenceOptimizer.replay(
        request.candidates,
        request.history,
        method=METHOD,
        seed=request.seed,
        settings=settings,
        people=_PEOPLE,
        pending=request.avoided,
        full_fits=remembered.of(request),
    )
    queries = optimizer.alternatives(request.person, request.choices, target=request.target)
    about = request.person if request.target == "person" else None
    fits = request.history and (
        request.acquires or any(query.trial_type == "model" for query in queries)
    )
    try:
        posterior = optimizer.posterior(about) if fits else None
    except FitError:
        posterior = None
    acquired = None
    if request.acquires and request.history:
        best = optimizer.best(about)
        if posterior is None:
            acquired = AcquiredCandidate(best, None, None)
        else:
            mean, std = (float(one[best]) for one in posterior)
            sureness = None if request.within is None else optimizer.sureness(request.within, about)
            acquired = AcquiredCandidate(best, mean, std, sureness)
    means = None if posterior is None else posterior[0]
    return SharedStep(tuple(Choice(query, _likelier(query, means)) for query in queries), acquired)


def _likelier(query: Query, mean: NDArray[np.float64] | None) -> str:
    if mean is None or query.trial_type != "model":
        return "left"
    return "left" if mean[query.left] >= mean[query.right] else "right"


#: What the child process remembers; it ends with that process.
_IN_CHILD: Final = RememberedFits()


def step_in_child(request: SharedRequest) -> SharedStep:
    """Compute one step in the child process."""
    return compute_shared_step(request, _IN_CHILD)


def forget_in_child(_: object = None) -> None:
    """Drop what the child process remembers."""
    _IN_CHILD.forget()
