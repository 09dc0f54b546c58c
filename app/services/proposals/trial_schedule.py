"""The course of a trial: what is shown at each of its places, from what was shown before.

Pure, as the optimiser's proposals are: the same trial, record and seed give the same query, so that
nothing here needs to be kept.
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

#: Tell draws apart from every other use of a trial's seed.
_REPLACEMENT_DRAW = 104
_SCHEDULE_DRAW = 106
_CHECK_DRAW = 107

#: A pair where a check was to be that could not be shown: it has no use, and teaches nothing.
FILLER = "filler"


@dataclass(frozen=True)
class AskedQuery:
    """A query as it was stored: candidates by their index, recordings by their id."""

    query_index: int
    trial_type: str
    left: int
    right: int
    left_recording: int
    right_recording: int
    acquisition: str
    engine_version: str
    repeats: int | None
    response: str | None
    skip_reason: str | None = None


#: The answered queries of a trial, in order: one for each place.
AnsweredQueries = tuple[AskedQuery, ...]


def is_training(trial: TrialSpec, trial_type: str) -> bool:
    """Whether the model learns from responses to queries of this type."""
    if trial_type in (Kind.REPEAT, Kind.ATTENTION):
        return trial.checks.in_model
    return trial_type != FILLER


def training_records(trial: TrialSpec, record: AnsweredQueries) -> AnsweredQueries:
    """The part of the record that the model learns from."""
    return tuple(shown for shown in record if is_training(trial, shown.trial_type))


def training_history(trial: TrialSpec, record: AnsweredQueries) -> History:
    """What the model learns from, as the optimiser takes it."""
    with_reasons = learns_reasons(trial.method, trial.engine_version)
    return tuple(
        (shown.left, shown.right, shown.response or "", shown.skip_reason)
        if with_reasons and shown.skip_reason in SKIP_REASONS
        else (shown.left, shown.right, shown.response or "")
        for shown in training_records(trial, record)
    )


def kind_at(trial: TrialSpec, place: int) -> Kind | None:
    """What comes at this place of a trial; None after the last."""
    places = _places(trial.seed, trial.queries, trial.repeats, trial.attention)
    return places[place] if place < len(places) else None


@lru_cache(maxsize=4096)
def _places(seed: int, queries: int, repeats: int, attention: int) -> tuple[Kind, ...]:
    return schedule(queries, repeats, attention, np.random.default_rng([seed, _SCHEDULE_DRAW]))


def next_query(
    candidate_set: CandidateSet, trial: TrialSpec, record: AnsweredQueries, step: NextStep
) -> ProposedQuery | None:
    """The query after these; None after the last. step: what follows what they taught."""
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
    """The check at this place. It does not depend on the response just before it."""
    rng = np.random.default_rng([trial.seed, _CHECK_DRAW, place])
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
    """An earlier query again, its sides swapped. The one just before would be recognised."""
    done = {shown.repeats for shown in record}
    open_to_it = [
        shown
        for shown in record
        if shown.query_index < place - 1
        and shown.query_index not in done
        and kind_at(trial, shown.query_index) is Kind.MODEL
    ]
    # Whether somebody chooses alike can be told of a choice; a skip is second best.
    chosen = [shown for shown in open_to_it if shown.response != "skip"] or open_to_it
    earlier = chosen[int(rng.integers(len(chosen)))]
    by_id = {
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


def replacement(
    candidate_set: CandidateSet,
    trial: TrialSpec,
    tried: Sequence[AskedQuery],
    usable: Callable[[RecordingRef], bool],
) -> ProposedQuery:
    """The query in place of one that did not play; `tried` are all attempts at its place.

    The same candidates by recordings that were not tried yet; where there are none, a random pair
    of other candidates. `usable` says whether a recording's video can be had. Raises
    NothingToShowError if hardly any can.
    """
    last = tried[-1]
    place = last.query_index
    rng = np.random.default_rng([trial.seed, _REPLACEMENT_DRAW, last.query_index, len(tried)])
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
    """Two of these candidates at random, in place of what could not be shown."""
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
    """Candidates that can be shown, without those tried; where too few are left, with them."""
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


def _recordings(shown: AskedQuery) -> tuple[int, int]:
    return shown.left_recording, shown.right_recording
