"""The course of a trial: what is shown at each of its places, from what was shown before.

Pure, as the optimiser's proposals are: the same trial, record and seed give the same query, so that
nothing here needs to be kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from app.pbbo import ENGINE_VERSION
from app.study.stages import PRACTICE

from .errors import NothingToShowError
from .proposals import Clip, History, NextQuery, Space, TrialInHand

#: Tells the draw of a replacement apart from every other use of a trial's seed.
_REPLACEMENT_DRAW = 104


@dataclass(frozen=True)
class Shown:
    """A query as it was stored: candidates by their index, recordings by their id."""

    query_index: int
    trial_type: str
    left: int
    right: int
    left_recording: int
    right_recording: int
    acquisition: str
    engine_version: str
    response: str | None


#: The answered queries of a trial, in order: one for each place.
Record = tuple[Shown, ...]


def learned(record: Record) -> History:
    """What the model learns from."""
    return tuple((shown.left, shown.right, shown.response or "") for shown in record)


def replacement(
    space: Space, trial: TrialInHand, tried: Sequence[Shown], usable: Callable[[Clip], bool]
) -> NextQuery:
    """The query in place of one that did not play; `tried` are all attempts at its place.

    The same candidates by recordings that were not tried yet; where there are none, a random pair
    of other candidates. `usable` says whether a recording's video can be had. Raises
    NothingToShowError if hardly any can.
    """
    last = tried[-1]
    rng = np.random.default_rng([trial.seed, _REPLACEMENT_DRAW, last.query_index, len(tried)])
    spent = {recording for shown in tried for recording in _recordings(shown)}

    def fresh(candidate: int) -> list[Clip]:
        return [clip for clip in space.clips[candidate] if clip.id not in spent and usable(clip)]

    left, right = fresh(last.left), fresh(last.right)
    if left and right:
        return NextQuery(
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
        )
    others = _other_candidates(space, tried, usable)
    pair = [int(others[place]) for place in rng.choice(len(others), 2, replace=False)]
    clips = [[clip for clip in space.clips[candidate] if usable(clip)] for candidate in pair]
    return NextQuery(
        query_index=last.query_index,
        trial_type=PRACTICE if last.trial_type == PRACTICE else "random",
        left_candidate=pair[0],
        right_candidate=pair[1],
        left=clips[0][int(rng.integers(len(clips[0])))],
        right=clips[1][int(rng.integers(len(clips[1])))],
        acquisition="replacement",
        seed=trial.seed,
        engine_version=ENGINE_VERSION,
        likelier="left",
    )


def _other_candidates(
    space: Space, tried: Sequence[Shown], usable: Callable[[Clip], bool]
) -> list[int]:
    """Candidates that can be shown, without those tried; where too few are left, with them."""
    can_be_shown = [
        candidate for candidate, clips in enumerate(space.clips) if any(map(usable, clips))
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


def _recordings(shown: Shown) -> tuple[int, int]:
    return shown.left_recording, shown.right_recording
