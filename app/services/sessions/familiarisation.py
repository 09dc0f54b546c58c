"""The familiarisation videos of a session: those shown before a trial, and those watched."""

from __future__ import annotations

import numpy as np

from app.services.context import AppContext
from app.services.proposals.proposer import RecordingRef
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import plan_of, stored_plan
from app.storage.models.studies import SessionRow
from app.study.assignment import sample_familiarisation

#: Separates this random stream from all other uses of a session's seed.
_DRAW = 102


def videos(app: AppContext, session: SessionRow) -> tuple[RecordingRef, ...]:
    """The videos before the coming trial, drawn from the session's seed: the same on each call."""
    plan = stored_plan(session.plan)
    if plan.blocks == "environment":
        condition = plan.conditions[session.trial_conditions[session.trial_index]]
        environments: tuple[str, ...] = (condition.environment,)
    else:
        environments = plan_of(session).used_environments
    found = [
        recording
        for environment in environments
        for recording in app.proposer.candidate_set(session.study_id, environment).all_recordings
    ]
    block = session.trial_index // plan_of(session).trials_per_block
    rng = np.random.default_rng([session.seed, _DRAW, *([block] if block else [])])
    drawn = sample_familiarisation(len(found), plan.familiarisation.videos, rng)
    return tuple(found[index] for index in drawn)


def device_check_videos(app: AppContext, session: SessionRow) -> tuple[RecordingRef, ...]:
    """The video of the session's device check: the study's first one, or none without a check."""
    plan = stored_plan(session.plan)
    if plan.device_check is None:
        return ()
    candidate_set = app.proposer.candidate_set(session.study_id, plan.used_environments[0])
    return candidate_set.all_recordings[:1]


def watched(session: SessionRow) -> list[int]:
    """Indices within this playlist, from 0, of the videos that were watched to the end."""
    first, size = _playlist_range(session)
    return sorted(place - first for place in session.watched if first <= place < first + size)


def first_index(session: SessionRow) -> int:
    """The index of this playlist's first video in all playlists of the session taken together."""
    return _playlist_range(session)[0]


def mark_watched(session: SessionRow, index: int) -> None:
    """Record that the video with this index was watched to the end. Raises NotFoundError."""
    first, size = _playlist_range(session)
    if not 0 <= index < size:
        raise NotFoundError(f"expected a video's place from 0 to {size - 1}, got {index}")
    # Assigned anew: SQLAlchemy does not track changes within a list.
    session.watched = sorted({*session.watched, first + index})


def _playlist_range(session: SessionRow) -> tuple[int, int]:
    """Where this block's playlist begins among all of the session, and its length."""
    plan = stored_plan(session.plan)
    size = plan.familiarisation.videos
    return session.trial_index // plan_of(session).trials_per_block * size, size
