"""The schedule of a trial: which query comes at each index, given the queries before it.

All functions are pure, like the optimiser's proposals: the same trial, queries and seed give the
same next query, so it can be recomputed instead of stored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from app.pbbo import SKIP_REASONS, learns_reasons
from app.services.runtime.errors import NothingToShowError
from app.study.attention_checks import Kind, schedule
from app.study.stage_settings import PRACTICE

from .attention_checks import attention
from .computation import History
from .proposer import CandidateSet, NextStep, ProposedQuery, RecordingRef, TrialSpec

#: Separate the random streams from the other uses of a trial's seed.
REPLACEMENT_DRAW = 104
_SCHEDULE_DRAW = 106
CHECK_DRAW = 107

#: Type of a random pair in place of a check that could not be shown. It is not learnt from.
FILLER = "filler"


@dataclass(frozen=True)
class AskedQuery:
    """A stored query with its response.

    left, right: candidate indices. left_recording, right_recording: primary keys; None while a
    machine has not recorded the video. repeats: index of the repeated query. response: None while
    the query is open.
    """

    query_index: int
    trial_type: str
    left: int
    right: int
    left_recording: int | None
    right_recording: int | None
    acquisition: str
    engine_version: str
    repeats: int | None
    response: str | None
    skip_reason: str | None = None


#: The answered queries of a trial, one for each index, in order.
AnsweredQueries = tuple[AskedQuery, ...]


def is_training(trial: TrialSpec, trial_type: str) -> bool:
    """Whether the model learns from responses to queries of this type."""
    if trial_type in (Kind.REPEAT, Kind.ATTENTION):
        return trial.checks.in_model
    return trial_type != FILLER


def training_records(trial: TrialSpec, record: AnsweredQueries) -> AnsweredQueries:
    """The answered queries that the model learns from."""
    return tuple(shown for shown in record if is_training(trial, shown.trial_type))


def training_history(trial: TrialSpec, record: AnsweredQueries) -> History:
    """The answered queries that the model learns from, in the form the optimiser reads."""
    with_reasons = learns_reasons(trial.method, trial.engine_version)
    return tuple(
        (shown.left, shown.right, shown.response or "", shown.skip_reason)
        if with_reasons and shown.skip_reason in SKIP_REASONS
        else (shown.left, shown.right, shown.response or "")
        for shown in training_records(trial, record)
    )


def kind_at(trial: TrialSpec, place: int) -> Kind | None:
    """The kind of query at this index of a trial; None after the last."""
    places = _places(trial.seed, trial.queries, trial.repeats, trial.attention)
    return places[place] if place < len(places) else None


@lru_cache(maxsize=4096)
def _places(seed: int, queries: int, repeats: int, attention: int) -> tuple[Kind, ...]:
    return schedule(queries, repeats, attention, np.random.default_rng([seed, _SCHEDULE_DRAW]))


def next_query(
    candidate_set: CandidateSet, trial: TrialSpec, record: AnsweredQueries, step: NextStep
) -> ProposedQuery | None:
    """The query after `record`; None after the last.

    step: the optimiser's step after `training_history(trial, record)`.
    """
    place = len(record)
    kind = kind_at(trial, place)
    if kind is None:
        return None
    if kind is not Kind.MODEL:
        return check_at(candidate_set, trial, record, place)
    assert step.next is not None
    return replace(step.next, query_index=place)


def check_at(
    candidate_set: CandidateSet, trial: TrialSpec, record: AnsweredQueries, place: int
) -> ProposedQuery:
    """The check at this index. It does not depend on the immediately preceding response."""
    rng = np.random.default_rng([trial.seed, CHECK_DRAW, place])
    if kind_at(trial, place) is Kind.ATTENTION:
        check = attention(candidate_set, trial, place, rng)
        if check is not None:
            return check
    else:
        return _repeat(candidate_set, trial, record, place, rng)
    return _filler(
        candidate_set, trial, place, rng, list(range(len(candidate_set.recordings))), lambda _: True
    )


def _repeat(
    candidate_set: CandidateSet,
    trial: TrialSpec,
    record: AnsweredQueries,
    place: int,
    rng: np.random.Generator,
) -> ProposedQuery:
    """An earlier query with its sides swapped."""
    earlier = repeated(trial, record, place, rng)
    by_id: dict[int | None, RecordingRef] = {
        recording.id: recording
        for side in (earlier.left, earlier.right)
        for recording in candidate_set.recordings[side]
    }
    return ProposedQuery(
        query_index=place,
        trial_type=Kind.REPEAT.value,
        left_candidate=earlier.right,
        right_candidate=earlier.left,
        left=by_id[earlier.right_recording],
        right=by_id[earlier.left_recording],
        acquisition="repeat",
        seed=trial.seed,
        engine_version=trial.engine_version,
        likelier="left",
        repeats=earlier.query_index,
    )


def repeated(
    trial: TrialSpec, record: AnsweredQueries, place: int, rng: np.random.Generator
) -> AskedQuery:
    """The query that the repeat at this index shows again.

    Never the one just before it, which is remembered.
    """
    done = {shown.repeats for shown in record}
    open_to_it = [
        shown
        for shown in record
        if shown.query_index < place - 1
        and shown.query_index not in done
        and kind_at(trial, shown.query_index) is Kind.MODEL
    ]
    # Consistency can be measured on choices; a skipped query is repeated only if there is no other.
    chosen = [shown for shown in open_to_it if shown.response != "skip"] or open_to_it
    return chosen[int(rng.integers(len(chosen)))]


def replacement(
    candidate_set: CandidateSet,
    trial: TrialSpec,
    tried: Sequence[AskedQuery],
    usable: Callable[[RecordingRef], bool],
) -> ProposedQuery:
    """The query that replaces one whose video did not play.

    It shows the same candidates by recordings that were not tried yet, or else a random pair of
    other candidates. tried: all attempts at this index, oldest first. usable: whether a recording's
    video is available. Raises NothingToShowError if fewer than two candidates have such a video.
    """
    last = tried[-1]
    place = last.query_index
    rng = np.random.default_rng([trial.seed, REPLACEMENT_DRAW, last.query_index, len(tried)])
    spent = {recording for shown in tried for recording in _recordings(shown)}

    if last.trial_type == Kind.ATTENTION:
        check = attention(
            candidate_set,
            trial,
            place,
            rng,
            lambda recording: recording.id not in spent and usable(recording),
        )
        if check is not None:
            return check

    def fresh(candidate: int) -> list[RecordingRef]:
        return [
            recording
            for recording in candidate_set.recordings[candidate]
            if recording.id not in spent and usable(recording)
        ]

    left, right = fresh(last.left), fresh(last.right)
    if left and right and last.trial_type != Kind.ATTENTION:
        return ProposedQuery(
            query_index=last.query_index,
            trial_type=last.trial_type,
            left_candidate=last.left,
            right_candidate=last.right,
            left=left[int(rng.integers(len(left)))],
            right=right[int(rng.integers(len(right)))],
            acquisition=last.acquisition,
            seed=trial.seed,
            engine_version=last.engine_version,
            likelier="left",
            repeats=last.repeats,
        )
    others = _other_candidates(candidate_set, tried, usable)
    random = _filler(candidate_set, trial, place, rng, others, usable)
    if last.trial_type == PRACTICE:
        return replace(random, trial_type=PRACTICE)
    if kind_at(trial, place) is Kind.MODEL:
        return replace(random, trial_type="random")
    return random


def _filler(
    candidate_set: CandidateSet,
    trial: TrialSpec,
    place: int,
    rng: np.random.Generator,
    candidates: Sequence[int],
    usable: Callable[[RecordingRef], bool],
) -> ProposedQuery:
    """A random pair of these candidates, of type FILLER."""
    drawn = rng.choice(len(candidates), 2, replace=False)
    pair = [candidates[int(index)] for index in drawn]
    recordings = [
        [recording for recording in candidate_set.recordings[candidate] if usable(recording)]
        for candidate in pair
    ]
    return ProposedQuery(
        query_index=place,
        trial_type=FILLER,
        left_candidate=pair[0],
        right_candidate=pair[1],
        left=recordings[0][int(rng.integers(len(recordings[0])))],
        right=recordings[1][int(rng.integers(len(recordings[1])))],
        acquisition="replacement",
        seed=trial.seed,
        engine_version=trial.engine_version,
        likelier="left",
    )


def _other_candidates(
    candidate_set: CandidateSet, tried: Sequence[AskedQuery], usable: Callable[[RecordingRef], bool]
) -> list[int]:
    """Candidates that can be shown and were not tried; if fewer than two, all that can be shown."""
    can_be_shown = [
        candidate
        for candidate, recordings in enumerate(candidate_set.recordings)
        if any(map(usable, recordings))
    ]
    spent = {candidate for shown in tried for candidate in (shown.left, shown.right)}
    others = [candidate for candidate in can_be_shown if candidate not in spent]
    if len(others) >= 2:
        return others
    if len(can_be_shown) >= 2:
        return can_be_shown
    raise NothingToShowError(
        f"expected two candidates with a video that can be shown, got {len(can_be_shown)}"
    )


def _recordings(shown: AskedQuery) -> tuple[int | None, int | None]:
    return shown.left_recording, shown.right_recording
