"""Summaries of what several people's answers say, cached by the answers they were computed from.

A summary takes a second for 150 answers and most of a minute for two hundred people with thirty
answers each. Few answers are summarised in the calling thread, many in a child process, and one
request at a time. Thread-safe.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import Lock, Thread
from typing import Any, Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from app.pbbo import PbboError, Settings
from app.pbbo.people_answers import PersonAnswer
from app.pbbo.people_summary import PeopleSummary, summarise_box, summarise_candidates
from app.services.runtime.child_process import child_context, set_up_child_process
from app.study.search_space import SearchSpace

from .boxes import box_in

log = logging.getLogger(__name__)

#: Cached summaries, some hundred kilobytes each.
MAX_SUMMARIES: Final = 64
#: Answers up to which a page waits for its summary, and up to which it is computed in this process
#: where the caller waits in any case.
FEW_ANSWERS: Final = 60
MANY_ANSWERS: Final = 600
#: The most answers that are summarised: a fit takes minutes and gigabytes beyond.
MOST_ANSWERS: Final = 12_000


@dataclass(frozen=True, eq=False)
class PeopleRequest:
    """What a summary is computed from.

    points: (n, d), the candidates, or in a space given by ranges those that were shown. space: None
    for a list of candidates. history: everybody's answers, which name rows of `points`. excluded:
    rows that are unsafe. seeds: of the trials that the answers are from.
    """

    points: NDArray[np.float64] = field(repr=False)
    space: SearchSpace | None
    settings: Mapping[str, Any]
    history: tuple[PersonAnswer, ...] = field(repr=False)
    excluded: tuple[int, ...] = ()
    seeds: frozenset[int] = field(default=frozenset(), repr=False)

    @property
    def key(self) -> str:
        """A digest of everything that the summary depends on."""
        digest = hashlib.sha256(self.points.tobytes())
        said = (
            self.points.shape,
            self.space,
            sorted(self.settings.items()),
            [tuple(answer) for answer in self.history],
            self.excluded,
        )
        digest.update(repr(said).encode())
        return digest.hexdigest()


class NoSummaryError(Exception):
    """There is no summary; the message says why, as a sentence."""


Outcome = PeopleSummary | NoSummaryError


def compute_summary(request: PeopleRequest) -> PeopleSummary:
    """Compute a summary. Pure. Raises NoSummaryError."""
    if len(request.history) > MOST_ANSWERS:
        raise NoSummaryError(
            f"There are {len(request.history)} answers, and at most {MOST_ANSWERS} are judged"
            " together. Choose fewer sessions."
        )
    settings = Settings.from_mapping(request.settings)
    try:
        if request.space is None:
            return summarise_candidates(request.points, request.history, settings)
        return summarise_box(
            box_in(request.space),
            request.points,
            request.history,
            settings,
            excluded=request.excluded,
        )
    except (PbboError, np.linalg.LinAlgError) as error:
        raise NoSummaryError(f"The model could not be fitted: {error}") from error


class PeopleSummaries:
    """Computes and caches summaries."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._turn = Lock()
        self._outcomes: LRUCache[str, tuple[frozenset[int], Outcome]] = LRUCache(MAX_SUMMARIES)
        self._under_way: set[str] = set()
        self._process: BaseProcess | None = None

    def find(self, request: PeopleRequest, most_here: int = MANY_ANSWERS) -> PeopleSummary:
        """The summary, computed now if it is not cached. Raises NoSummaryError.

        most_here: more answers are summarised in a child process.
        """
        key = request.key
        outcome = self._cached(key)
        if outcome is None:
            with self._turn:
                # Another thread may have computed it meanwhile.
                outcome = self._cached(key)
                if outcome is None:
                    outcome = self._computed(request, most_here)
                    with self._lock:
                        self._outcomes[key] = (request.seeds, outcome)
        if isinstance(outcome, NoSummaryError):
            raise outcome
        return outcome

    def find_or_start(self, request: PeopleRequest) -> PeopleSummary | None:
        """The cached summary; None while it is computed in the background.

        A summary of few answers is computed at once. Raises NoSummaryError.
        """
        key = request.key
        if len(request.history) <= FEW_ANSWERS or self._cached(key) is not None:
            return self.find(request)
        with self._lock:
            if key in self._under_way:
                return None
            self._under_way.add(key)
        Thread(target=self._find_quietly, args=(key, request), daemon=True).start()
        return None

    def seeds(self) -> frozenset[int]:
        """The seeds of all trials whose answers are in a cached summary."""
        with self._lock:
            return frozenset(seed for seeds, _ in self._outcomes.values() for seed in seeds)

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop the summaries with answers from these trials."""
        with self._lock:
            gone = [key for key, (of, _) in self._outcomes.items() if of & seeds]
            for key in gone:
                del self._outcomes[key]

    def close(self) -> None:
        """Drop all summaries, and terminate the child process, if there is one."""
        with self._lock:
            self._outcomes.clear()
            if self._process is not None:
                self._process.terminate()

    def _cached(self, key: str) -> Outcome | None:
        with self._lock:
            found = self._outcomes.get(key)
        return None if found is None else found[1]

    def _find_quietly(self, key: str, request: PeopleRequest) -> None:
        try:
            self.find(request, FEW_ANSWERS)
        except NoSummaryError as error:
            log.info("no summary of several people's answers: %s", error)
        finally:
            with self._lock:
                self._under_way.discard(key)

    def _computed(self, request: PeopleRequest, most_here: int) -> Outcome:
        if len(request.history) > most_here:
            return self._in_child(request)
        return _outcome(request)

    def _in_child(self, request: PeopleRequest) -> Outcome:
        context = child_context()
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=_child, args=(request, there), daemon=True)
        with self._lock:
            process.start()
            self._process = process
        there.close()
        try:
            outcome: Outcome = here.recv()
        except EOFError:
            raise NoSummaryError("The computation was stopped.") from None
        finally:
            process.join()
            here.close()
            with self._lock:
                self._process = None
        return outcome


def _child(request: PeopleRequest, out: Connection) -> None:
    set_up_child_process()
    out.send(_outcome(request))


def _outcome(request: PeopleRequest) -> Outcome:
    try:
        return compute_summary(request)
    except NoSummaryError as error:
        return error
