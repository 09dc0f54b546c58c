"""What comes after a trial's history: the next query, and what the responses so far have taught.

A step is a pure function of the candidates, the condition, the history and the trial's seed. So it
can be worked out ahead for each possible response while the videos play, thrown away, and worked
out again anywhere: nothing here needs to be kept.
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

from .computation import (
    AcquiredCandidate,
    FitProcess,
    History,
    Question,
    StepResult,
    compute_step,
    compute_steps,
)
from .posterior_cache import PosteriorCache
from .step_cache import StepCache

#: Environments whose candidates are cached: a few hundred kilobytes each.
MAX_SPACES = 64
#: Tells the draw of recordings apart from every other use of a trial's seed.
_RECORDING_DRAW = 101


@dataclass(frozen=True)
class Clip:
    """A recording as a query needs it."""

    id: int
    public_id: str
    duration_s: float
    source: str
    locator: str
    score: float | None


@dataclass(frozen=True)
class Space:
    """The candidates of one environment, (n, d), and the clips of each."""

    candidates: NDArray[np.float64] = field(repr=False)
    clips: tuple[tuple[Clip, ...], ...] = field(repr=False)
    parameters: tuple[str, ...] = ()

    def clip(self, candidate: int, recording_id: int) -> Clip:
        """The candidate's clip of this recording."""
        return next(clip for clip in self.clips[candidate] if clip.id == recording_id)

    @property
    def all_clips(self) -> tuple[Clip, ...]:
        return tuple(clip for clips in self.clips for clip in clips)


@dataclass(frozen=True)
class TrialSpec:
    """All that a proposal depends on besides the history."""

    study_id: int
    environment: str
    method: str
    settings: Mapping[str, Any] = field(hash=False)
    seed: int
    queries: int
    repeats: int = 0
    attention: int = 0
    checks: Checks = field(default=Checks(), hash=False)
    #: The engine that the trial began under, whose settings it keeps.
    engine_version: str = ENGINE_VERSION

    @property
    def most_learned(self) -> int:
        """How many responses the model learns from in the end."""
        return self.queries + (self.repeats + self.attention if self.checks.in_model else 0)


@dataclass(frozen=True)
class ProposedQuery:
    """A query to be stored and shown.

    likelier: the side that the model expects to win. repeats: the earlier query shown again.
    """

    query_index: int
    trial_type: str
    left_candidate: int
    right_candidate: int
    left: Clip
    right: Clip
    acquisition: str
    seed: int
    engine_version: str
    likelier: str
    repeats: int | None = None


@dataclass(frozen=True)
class Step:
    """What follows a history: the next query (None after the last), and what was learnt."""

    next: ProposedQuery | None
    preferences: tuple[Preference, ...]
    acquired: AcquiredCandidate | None


class Proposer:
    """Works steps out, now or ahead."""

    def __init__(
        self,
        database: Database,
        background: Background,
        render: Callable[[Clip], None],
        measurements: Metrics,
    ) -> None:
        self._database = database
        self._background = background
        self._render = render
        self._measurements = measurements
        self._spaces: LRUCache[tuple[int, str], Space] = LRUCache(MAX_SPACES)
        self._lock = Lock()
        self._steps = StepCache[Step]()
        self._elsewhere = FitProcess()
        #: For the pages that show a session's models.
        self.posteriors = PosteriorCache()

    def space(self, study_id: int, environment: str) -> Space:
        """The candidates and clips of a study's environment; they never change."""
        key = (study_id, environment)
        with self._lock:
            space = self._spaces.get(key)
        if space is None:
            space = _read_space(self._database, study_id, environment)
            with self._lock:
                self._spaces[key] = space
        return space

    def step(self, trial: TrialSpec, history: History) -> Step:
        """What follows `history`: from what was worked out ahead, or worked out now."""
        step = self.cached_step(trial, history)
        if step is None:
            # A fit holds everybody else here up, but nobody should wait for a process to start.
            here = not history or not self._elsewhere.is_ready
            thinks = compute_steps if here else self._elsewhere.compute_step
            [step] = self._work_out(trial, [history], thinks)
        return step

    def purge(self, seeds: frozenset[int]) -> None:
        """Drop all that is cached of these deleted trials, and refuse further steps of them."""
        self.posteriors.purge(seeds)
        self._steps.purge(seeds)

    def cached_seeds(self) -> frozenset[int]:
        """The seeds of all trials with a cached step or posterior."""
        return self.posteriors.seeds() | self._steps.seeds()

    def evict(self, seeds: frozenset[int]) -> None:
        """Drop all that is cached of these trials; what is asked for is computed again."""
        self.posteriors.evict(seeds)
        self._steps.evict(seeds)

    def cached_step(self, trial: TrialSpec, history: History) -> Step | None:
        """The step after `history`, if it was computed ahead."""
        return self._steps.get(trial.seed, [history])[0]

    def precompute(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> None:
        """Begin to work out what follows each possible response to the open query `pair`."""
        self._steps.advance(trial.seed, len(history))
        self._background.in_thread(
            ("ahead", trial.seed, len(history), pair), self._precompute, trial, history, pair
        )

    def possible_queries(
        self, trial: TrialSpec, history: History, pair: tuple[int, int]
    ) -> list[ProposedQuery]:
        """The next queries, the likeliest first: all, or none as long as they are worked out."""
        steps = self._steps.get(trial.seed, self._futures(trial, history, pair))
        if None in steps:
            # Of a response that was taken back, say: whoever has some asks for no more.
            return []
        return [step.next for step in steps if step is not None and step.next is not None]

    def close(self) -> None:
        self._elsewhere.close()

    def render(self, clips: Sequence[Clip]) -> None:
        """Begin to make the videos that are not there yet."""
        for clip in clips:
            self._render(clip)

    def _futures(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> list[History]:
        """What the history may be after the open query, the likeliest first."""
        step = self.cached_step(trial, history)
        likelier = step.next.likelier if step is not None and step.next is not None else "left"
        responses = ["left", "right"] if likelier == "left" else ["right", "left"]
        if allows_skip(trial.method):
            responses.append("skip")
        return [(*history, (*pair, response)) for response in responses]

    def _precompute(self, trial: TrialSpec, history: History, pair: tuple[int, int]) -> None:
        if self._steps.position(trial.seed) != len(history):
            # It was answered meanwhile: on a busy machine that time is somebody else's.
            return
        futures = self._futures(trial, history, pair)
        known = self._steps.get(trial.seed, futures)
        missing = [after for after, step in zip(futures, known, strict=True) if step is None]
        if missing:
            for step in self._work_out(trial, missing, self._elsewhere.compute_step):
                if step.next is not None:
                    self.render([step.next.left, step.next.right])

    def _work_out(
        self,
        trial: TrialSpec,
        histories: Sequence[History],
        thinks: Callable[[Sequence[Question]], list[StepResult]],
    ) -> list[Step]:
        """The steps after these histories, which are kept from now on."""
        space = self.space(trial.study_id, trial.environment)
        with self._measurements.fitting(len(histories)):
            thoughts = thinks([_question(space, trial, history) for history in histories])
        steps = [_step(space, trial, thought) for thought in thoughts]
        self._steps.put(trial.seed, dict(zip(histories, steps, strict=True)))
        return steps


def work_out(space: Space, trial: TrialSpec, history: History) -> Step:
    """The step after `history`, from nothing but its arguments."""
    return _step(space, trial, compute_step(_question(space, trial, history)))


def _question(space: Space, trial: TrialSpec, history: History) -> Question:
    return Question(
        candidates=space.candidates,
        method=trial.method,
        settings=trial.settings,
        seed=trial.seed,
        history=history,
        ends=len(history) >= trial.most_learned,
    )


def _step(space: Space, trial: TrialSpec, thought: StepResult) -> Step:
    """A thought, with the recordings that show its query."""
    query = thought.query
    return Step(
        next=None if query is None else _next_query(space, trial, query, thought.likelier),
        preferences=thought.preferences,
        acquired=thought.acquired,
    )


def _next_query(space: Space, trial: TrialSpec, query: Query, likelier: str) -> ProposedQuery:
    rng = np.random.default_rng([trial.seed, _RECORDING_DRAW, query.index])
    left, right = (
        clips[int(rng.integers(len(clips)))]
        for clips in (space.clips[query.left], space.clips[query.right])
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


def _read_space(database: Database, study_id: int, environment: str) -> Space:
    with database.read() as db:
        rows = db.execute(
            select(
                Candidate.candidate_index,
                Candidate.parameters,
                Recording.id,
                Recording.public_id,
                Recording.duration_s,
                Recording.source,
                Recording.locator,
                Recording.score,
            )
            .join(Recording, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == study_id, Candidate.environment == environment)
            .order_by(Candidate.candidate_index, Recording.run_index)
        ).all()
    names: tuple[str, ...] = ()
    points: dict[int, list[float]] = {}
    clips: dict[int, list[Clip]] = {}
    for index, parameters, *clip in rows:
        names = tuple(parameters)
        points[index] = list(parameters.values())
        clips.setdefault(index, []).append(Clip(*clip))
    return Space(
        np.array([points[index] for index in sorted(points)], dtype=np.float64),
        tuple(tuple(clips[index]) for index in sorted(clips)),
        names,
    )
