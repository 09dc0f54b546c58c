"""What follows a history of a trial over a search space: the next pair, and the derived rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.pbbo import Preference
from app.services.proposals.box_proposer import BoxProposer
from app.services.proposals.box_steps import BoxRequest, BoxStep, Point, ProposedPair
from app.services.proposals.computation import AcquiredCandidate
from app.services.proposals.proposer import NextStep
from app.services.proposals.trial_schedule import (
    CHECK_DRAW,
    AnsweredQueries,
    AskedQuery,
    is_training,
    kind_at,
    repeated,
)
from app.storage.models.studies import Candidate
from app.study.attention_checks import Kind

from . import box_trials
from .box_trials import Barred, BoxTrial, Sources


@dataclass(frozen=True)
class Following:
    """What is to be computed after a record.

    place: index of the next query. repeats: the earlier query that it shows again; None if the
    model proposes it. query, acquired: the sources of the proposal and of the acquired candidate,
    with the requests that compute them; None where there is no proposal, or nothing is acquired.
    """

    place: int
    repeats: AskedQuery | None
    query: tuple[Sources, BoxRequest] | None
    acquired: tuple[Sources, BoxRequest] | None

    @property
    def requests(self) -> list[BoxRequest]:
        """The requests, each once."""
        parts = [part[1] for part in (self.query, self.acquired) if part is not None]
        return list(dict.fromkeys(parts))

    @property
    def sources(self) -> tuple[Sources | None, Sources | None]:
        """The sources of proposal and acquired candidate."""
        return (
            None if self.query is None else self.query[0],
            None if self.acquired is None else self.acquired[0],
        )


@dataclass(frozen=True)
class Computed:
    """The results of a `Following`. pair: None for a repeat, and after the last query."""

    following: Following
    pair: ProposedPair | None
    acquired: BoxStep | None

    @property
    def pair_points(self) -> list[Point]:
        """The points of the pair; none without one."""
        return [] if self.pair is None else [self.pair.left, self.pair.right]

    @property
    def points(self) -> list[Point]:
        """The points that need a row."""
        found = self.pair_points
        if self.acquired is not None and self.acquired.acquired is not None:
            found.append(self.acquired.acquired.point)
        return found


def after(
    trial: BoxTrial, record: AnsweredQueries, barred: Barred, points: Mapping[int, Point]
) -> Following:
    """What follows these answered queries, the first of the trial if there are none."""
    place = len(record)
    kind = kind_at(trial.spec, place)
    repeats = None
    if kind is Kind.REPEAT:
        repeats = _repeated(trial, record, place, barred)
    query = acquired = None
    if kind is not None and repeats is None:
        query = box_trials.sources_of_query(trial, record, place, barred)
    if record and is_training(trial.spec, record[-1].trial_type):
        acquired = box_trials.sources_of_acquired(trial, record, barred)
    if query is not None and query == acquired:
        both = box_trials.request(trial, record, query, points, proposes=True, acquires=True)
        return Following(place, repeats, (query, both), (acquired, both))

    def part(
        sources: Sources | None, *, proposes: bool, acquires: bool
    ) -> tuple[Sources, BoxRequest] | None:
        if sources is None:
            return None
        wanted = box_trials.request(
            trial, record, sources, points, proposes=proposes, acquires=acquires
        )
        return sources, wanted

    return Following(
        place,
        repeats,
        part(query, proposes=True, acquires=False),
        part(acquired, proposes=False, acquires=True),
    )


def compute(proposer: BoxProposer, following: Following) -> Computed:
    """Compute what follows, or take it from the cache. Not within a transaction: fits models."""
    steps = dict(zip(following.requests, map(proposer.step, following.requests), strict=True))
    return _computed(following, steps)


def cached(proposer: BoxProposer, following: Following) -> Computed | None:
    """What follows, if all of it is cached."""
    steps = {}
    for request in following.requests:
        step = proposer.cached(request)
        if step is None:
            return None
        steps[request] = step
    return _computed(following, steps)


def futures(
    trial: BoxTrial,
    record: AnsweredQueries,
    asked: AskedQuery,
    barred: Barred,
    points: Mapping[int, Point],
    likelier: str,
) -> list[Following]:
    """What follows each possible response to the open query, the likeliest first."""
    responses = ["left", "right"] if likelier == "left" else ["right", "left"]
    return [
        after(trial, (*record, replace(asked, response=response)), barred, points)
        for response in (*responses, "skip")
    ]


def derived(
    computed: Computed, candidates: Mapping[Point, Candidate], record: AnsweredQueries
) -> tuple[NextStep, AnsweredQueries] | None:
    """The derived rows of a computation, and the records that they number; None if there are none.

    candidates: the rows of at least `computed.points`.
    """
    part, step = computed.following.acquired, computed.acquired
    if part is None or step is None:
        return None
    taught, training = learnt(record, part[0])
    acquired = None
    if step.acquired is not None:
        found = step.acquired
        acquired = AcquiredCandidate(
            candidates[found.point].candidate_index, found.mean, found.std, found.sureness
        )
    return replace(taught, acquired=acquired), training


def learnt(record: AnsweredQueries, sources: Sources) -> tuple[NextStep, AnsweredQueries]:
    """The preferences that these sources hold, and the records that they number."""
    training = tuple(one for one in record if one.query_index in sources.answered)
    # The model learns each answer as it is: nothing is drawn for a skip.
    preferences = tuple(
        Preference(*_winner_first(asked), "answer", number)
        for number, asked in enumerate(training)
        if asked.response != "skip"
    )
    return NextStep(None, preferences, None), training


def _winner_first(asked: AskedQuery) -> tuple[int, int]:
    pair = (asked.left, asked.right)
    return pair if asked.response == "left" else pair[::-1]


def _computed(following: Following, steps: Mapping[BoxRequest, BoxStep]) -> Computed:
    return Computed(
        following,
        None if following.query is None else steps[following.query[1]].pair,
        None if following.acquired is None else steps[following.acquired[1]],
    )


def _repeated(
    trial: BoxTrial, record: Sequence[AskedQuery], place: int, barred: Barred
) -> AskedQuery | None:
    """The query to show again; None if the recordings of all of them were withdrawn."""
    usable = tuple(one for one in record if one.query_index not in barred.withdrawn)
    rng = np.random.default_rng([trial.spec.seed, CHECK_DRAW, place])
    try:
        return repeated(trial.spec, usable, place, rng)
    except ValueError:
        # There is none to draw from.
        return None
