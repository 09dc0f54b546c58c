"""Computes, precomputes and caches the step after a trial's history.

A step is the next query together with the preferences and the acquired candidate derived from the
responses so far. It is a pure function of the candidates, the condition, the history and the
trial's seed. It can therefore be computed in advance for each possible response while the videos
play, dropped from the cache, and computed again with the same result by any process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from sqlalchemy import select

from app.pbbo import ENGINE_VERSION, Preference, Query, allows_skip
from app.services.background.interface import Background
from app.services.runtime.metrics import Metrics
from app.storage.database import Database
from app.storage.models.studies import Candidate, Recording
from app.study.attention_checks import Checks
from app.study.stopping import USUAL_WITHIN

from .box_proposer import BoxProposer
from .box_steps import AcquiredPoint
from .computation import (
    AcquiredCandidate,
    FitProcess,
    History,
    StepRequest,
    StepResult,
    compute_step,
    compute_steps,
)
from .people_summaries import PeopleSummaries
from .posterior_cache import PosteriorCache
from .shared_proposer import SharedProposer
from .step_cache import StepCache

#: Cached candidate sets, one per environment, a few hundred kilobytes each.
MAX_CANDIDATE_SETS = 64
#: Separates the random stream of recordings from the other uses of a trial's seed.
_RECORDING_DRAW = 101


@dataclass(frozen=True)
class RecordingRef:
    """The columns of a recording that a query needs. id: primary key."""

    id: int
    public_id: str
    duration_s: float
    source: str
    locator: str
    score: float | None


@dataclass(frozen=True)
class CandidateSet:
    """The candidates of one environment and their recordings.

    candidates: (n, d). recordings: n tuples of one or more, or in a search space given by ranges of
    none or more, as far as they were recorded. parameters: the d names of the columns.
    """

    candidates: NDArray[np.float64] = field(repr=False)
    recordings: tuple[tuple[RecordingRef, ...], ...] = field(repr=False)
    parameters: tuple[str, ...] = ()

    def recording(self, candidate: int, recording_id: int | None) -> RecordingRef:
        """The recording with this primary key among the candidate's recordings."""
        return next(
            recording for recording in self.recordings[candidate] if recording.id == recording_id
        )

    @property
    def all_recordings(self) -> tuple[RecordingRef, ...]:
        return tuple(recording for recordings in self.recordings for recording in recordings)


@dataclass(frozen=True)
class TrialSpec:
    """The constants of a trial: everything besides the history that its proposals depend on.

    queries, repeats, attention: numbers of queries of each type.
    """

    study_id: int
    environment: str
    method: str
    settings: Mapping[str, Any] = field(hash=False)
    seed: int
    queries: int
    repeats: int = 0
    attention: int = 0
    checks: Checks = field(default=Checks(), hash=False)
    #: Version of the optimiser at the start of the trial.
    engine_version: str = ENGINE_VERSION
    #: What the acquired candidate is to be sure of (see `StepRequest`).
    within: float | None = USUAL_WITHIN
    #: The trial ends as soon as it is this sure; None: after all its queries.
    sure: float | None = None

    def is_sure(self, acquired: AcquiredCandidate | AcquiredPoint | None) -> bool:
        """Whether the trial ends with what it acquired, being as sure as its plan wants."""
        sureness = None if acquired is None else acquired.sureness
        return self.sure is not None and sureness is not None and sureness >= self.sure

    @property
    def training_responses(self) -> int:
        """Number of responses that the model learns from by the end of the trial."""
        return self.queries + (self.repeats + self.attention if self.checks.in_model else 0)


@dataclass(frozen=True)
class ProposedQuery:
    """A query that is not stored yet.

    likelier: the side that the model expects to win. repeats: index of the earlier query that this
    one repeats.
    """

    query_index: int
    trial_type: str
    left_candidate: int
    right_candidate: int
    left: RecordingRef
    right: RecordingRef
    acquisition: str
    seed: int
    engine_version: str
    likelier: str
    repeats: int | None = None


@dataclass(frozen=True)
class NextStep:
    """The step after a history: the next query (None after the last) and the derived rows."""

    next: ProposedQuery | None
    preferences: tuple[Preference, ...]
    acquired: AcquiredCandidate | None


class Proposer:
    """Computes steps on request or in advance, and caches them with the candidate sets.

    render: starts rendering a recording's video in the background. Thread-safe.
    """

    def __init__(
        self,
        database: Database,
        background: Background,
        render: Callable[[RecordingRef], None],
        metrics: Metrics,
    ) -> None:
        self._database = database
        self._background = background
        self._render = render
        self._metrics = metrics
        self._candidate_sets: LRUCache[tuple[int, str], CandidateSet] = LRUCache(MAX_CANDIDATE_SETS)
        self._lock = Lock()
        self._steps = StepCache[NextStep]()
        self._fit_process = FitProcess()
        #: Steps over search spaces given by ranges.
        self.boxes = BoxProposer(self._fit_process, metrics)
        #: Steps of models that several people share.
        self.shared = SharedProposer(self._fit_process, background, metrics)
        #: Posteriors for session pages.
        self.posteriors = PosteriorCache()
        #: Summaries of several people's answers, for results and exports.
        self.people = PeopleSummaries()

    def candidate_set(self, study_id: int, environment: str) -> CandidateSet:
        """The candidates and recordings of a study's environment.

        Cached, because lists of candidates never change. Those of a search space given by ranges
        do, and are read at each call.
        """
        key = (study_id, environment)
        with self._lock:
            candidate_set = self._candidate_sets.get(key)
        if candidate_set is None:
            candidate_set, grows = _read_candidate_set(self._database, study_id, environment)
            if not grows:
                with self._lock:
                    self._candidate_sets[key] = candidate_set
        return candidate_set

    def step(self, trial: TrialSpec, history: History) -> NextStep:
        """The step after `history`: from the cache if it is there, otherwise computed now."""
        step = self.cached_step(trial, history)
        if step is None:
            # A fit in this process delays other requests, but less than starting a child would.
            here = not history or not self._fit_process.is_ready
            compute = compute_steps if here else self._fit_process.compute_steps
            [step] = self._compute(trial, [history], compute)
        return step

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop everything cached for these deleted trials, and cache nothing more for them."""
        self.posteriors.purge(seeds)
        self.people.evict(seeds)
        self._steps.purge(seeds)
        self.boxes.purge(seeds)
        self.shared.purge(seeds)

    def cached_seeds(self) -> frozenset[int]:
        """The seeds of all trials with a cached step or posterior."""
        caches = (self.posteriors, self.people, self._steps, self.boxes, self.shared)
        return frozenset().union(*(cache.seeds() for cache in caches))

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop everything cached for these trials; it is computed again on request."""
        self.posteriors.evict(seeds)
        self.people.evict(seeds)
        self._steps.evict(seeds)
        self.boxes.evict(seeds)
        self.shared.evict(seeds)

    def cached_step(self, trial: TrialSpec, history: History) -> NextStep | None:
        """The step after `history` if it is cached, otherwise None."""
        return self._steps.get(trial.seed, [history])[0]

    def precompute(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> None:
        """Start to compute the step after each possible response to the open query.

        pair: left and right candidate of the open query. Returns immediately; the work is done in
        the background thread.
        """
        self._steps.advance(trial.seed, len(history))
        self._background.in_thread(
            ("ahead", trial.seed, len(history), pair), self._precompute, trial, history, pair
        )

    def possible_queries(
        self, trial: TrialSpec, history: History, pair: tuple[int, int]
    ) -> list[ProposedQuery]:
        """The next query for each possible response, the likeliest response first.

        Empty until all of them have been computed.
        """
        steps = self._steps.get(trial.seed, self._futures(trial, history, pair))
        if None in steps:
            # Some may be left from an undone response; the client stops polling once it has any.
            return []
        return [step.next for step in steps if step is not None and step.next is not None]

    def close(self) -> None:
        """Stop the child processes."""
        self._fit_process.close()
        self.people.close()

    def render(self, recordings: Sequence[RecordingRef]) -> None:
        """Start to render those videos that do not exist yet, in the background."""
        for recording in recordings:
            self._render(recording)

    def _futures(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> list[History]:
        """The possible histories after the open query, the likeliest first."""
        step = self.cached_step(trial, history)
        likelier = step.next.likelier if step is not None and step.next is not None else "left"
        responses = ["left", "right"] if likelier == "left" else ["right", "left"]
        if allows_skip(trial.method):
            responses.append("skip")
        return [(*history, (*pair, response)) for response in responses]

    def _precompute(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> None:
        if self._steps.position(trial.seed) != len(history):
            # The query has been answered meanwhile, so these steps are no longer needed.
            return
        futures = self._futures(trial, history, pair)
        known = self._steps.get(trial.seed, futures)
        missing = [after for after, step in zip(futures, known, strict=True) if step is None]
        if missing:
            for step in self._compute(trial, missing, self._fit_process.compute_steps):
                if step.next is not None:
                    self.render([step.next.left, step.next.right])

    def _compute(
        self,
        trial: TrialSpec,
        histories: Sequence[History],
        compute: Callable[[Sequence[StepRequest]], list[StepResult]],
    ) -> list[NextStep]:
        """Compute and cache the steps after these histories."""
        candidate_set = self.candidate_set(trial.study_id, trial.environment)
        with self._metrics.fitting(len(histories)):
            results = compute(
                [_step_request(candidate_set, trial, history) for history in histories]
            )
        steps = [_step(candidate_set, trial, result) for result in results]
        self._steps.put(trial.seed, dict(zip(histories, steps, strict=True)))
        return steps


def next_step(candidate_set: CandidateSet, trial: TrialSpec, history: History) -> NextStep:
    """Compute the step after `history` without any cache. Pure."""
    return _step(candidate_set, trial, compute_step(_step_request(candidate_set, trial, history)))


def _step_request(candidate_set: CandidateSet, trial: TrialSpec, history: History) -> StepRequest:
    return StepRequest(
        candidates=candidate_set.candidates,
        method=trial.method,
        settings=trial.settings,
        seed=trial.seed,
        history=history,
        ends=len(history) >= trial.training_responses,
        within=trial.within,
    )


def _step(candidate_set: CandidateSet, trial: TrialSpec, result: StepResult) -> NextStep:
    """The step of a result, with recordings drawn for its query."""
    query = result.query
    return NextStep(
        next=None
        if query is None
        else with_recordings(candidate_set, trial, query, result.likelier),
        preferences=result.preferences,
        acquired=result.acquired,
    )


def with_recordings(
    candidate_set: CandidateSet, trial: TrialSpec, query: Query, likelier: str
) -> ProposedQuery:
    """A query of the optimiser with recordings drawn for it."""
    rng = np.random.default_rng([trial.seed, _RECORDING_DRAW, query.index])
    left, right = (
        recordings[int(rng.integers(len(recordings)))]
        for recordings in (
            candidate_set.recordings[query.left],
            candidate_set.recordings[query.right],
        )
    )
    return ProposedQuery(
        query_index=query.index,
        trial_type=query.trial_type,
        left_candidate=query.left,
        right_candidate=query.right,
        left=left,
        right=right,
        acquisition=query.acquisition,
        seed=query.seed,
        engine_version=trial.engine_version,
        likelier=likelier,
    )


def _read_candidate_set(
    database: Database, study_id: int, environment: str
) -> tuple[CandidateSet, bool]:
    """The candidates of an environment, and whether more may be added to them later."""
    with database.read() as db:
        rows = db.execute(
            select(
                Candidate.candidate_index,
                Candidate.parameters,
                Candidate.point_key,
                Recording.id,
                Recording.public_id,
                Recording.duration_s,
                Recording.source,
                Recording.locator,
                Recording.score,
            )
            .outerjoin(Recording, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == study_id, Candidate.environment == environment)
            .order_by(Candidate.candidate_index, Recording.run_index)
        ).all()
    names: tuple[str, ...] = ()
    points: dict[int, list[float]] = {}
    recordings: dict[int, list[RecordingRef]] = {}
    grows = not rows
    for index, parameters, point_key, *recording in rows:
        names = tuple(parameters)
        points[index] = list(parameters.values())
        grows = grows or point_key is not None
        held = recordings.setdefault(index, [])
        if recording[0] is not None:
            held.append(RecordingRef(*recording))
    candidate_set = CandidateSet(
        np.array([points[index] for index in sorted(points)], dtype=np.float64),
        tuple(tuple(recordings[index]) for index in sorted(recordings)),
        names,
    )
    return candidate_set, grows
