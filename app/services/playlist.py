"""The videos that a session watches to get to know what it will judge, and which it has watched."""

from __future__ import annotations

import numpy as np

from app.storage.tables import SessionRow
from app.study.assignment import sample_familiarisation

from .errors import NotFoundError
from .proposals import Clip
from .studies import plan_of, stored_plan
from .studio import Studio

#: Tells the draw of familiarisation videos apart from every other use of a session's seed.
_DRAW = 102


def clips(studio: Studio, row: SessionRow) -> tuple[Clip, ...]:
    """The videos before the trial that comes next: drawn by the session's seed, alike each time."""
    plan = stored_plan(row.plan)
    if plan.blocks == "environment":
        coming = plan.conditions[row.trial_conditions[row.trial_index]]
        environments: tuple[str, ...] = (coming.environment,)
    else:
        environments = plan_of(row).used_environments
    found = [
        clip
        for environment in environments
        for clip in studio.proposer.space(row.study_id, environment).all_clips
    ]
    block = row.trial_index // plan_of(row).trials_per_block
    rng = np.random.default_rng([row.seed, _DRAW, *([block] if block else [])])
    drawn = sample_familiarisation(len(found), plan.familiarisation.videos, rng)
    return tuple(found[index] for index in drawn)


def test_clips(studio: Studio, row: SessionRow) -> tuple[Clip, ...]:
    """The video of the session's device check: any that the study has."""
    plan = stored_plan(row.plan)
    if plan.device_check is None:
        return ()
    space = studio.proposer.space(row.study_id, plan.used_environments[0])
    return space.all_clips[:1]


def watched(row: SessionRow) -> list[int]:
    """Places of this playlist, from 0, that were watched to the end."""
    first, size = _places(row)
    return sorted(place - first for place in row.watched if first <= place < first + size)


def first_place(row: SessionRow) -> int:
    """The place of this playlist's first video among those of all the session's playlists."""
    return _places(row)[0]


def mark_watched(row: SessionRow, index: int) -> None:
    """Keep that the video at this place was watched to the end. Raises NotFoundError."""
    first, size = _places(row)
    if not 0 <= index < size:
        raise NotFoundError(f"expected a video's place from 0 to {size - 1}, got {index}")
    # Another list: a change within one would not be noticed, and not be stored.
    row.watched = sorted({*row.watched, first + index})


def _places(row: SessionRow) -> tuple[int, int]:
    """Where this block's playlist begins among all the session's, and how long it is."""
    plan = stored_plan(row.plan)
    size = plan.familiarisation.videos
    return row.trial_index // plan_of(row).trials_per_block * size, size
