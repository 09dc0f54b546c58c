"""The recordings of candidates as experimenters' pages play them."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any

from app.services.context import AppContext
from app.services.proposals.proposer import CandidateSet
from app.services.recordings.recordings import video_url


@dataclass(frozen=True)
class Video:
    """A recording that was shown. ready: its file exists and need not be rendered."""

    candidate: int
    parameters: Mapping[str, float]
    url: str
    ready: bool
    score: float | None


def video(there: Container[str], space: CandidateSet, candidate: int, recording: Any) -> Video:
    """The video of one recording. there: locators of the files that exist."""
    return Video(
        candidate,
        parameters_of(space, candidate),
        video_url(recording.public_id),
        recording.locator in there,
        recording.score,
    )


def parameters_of(space: CandidateSet, candidate: int) -> dict[str, float]:
    """The parameters of a candidate by name."""
    point = map(float, space.candidates[candidate])
    return dict(zip(space.parameters, point, strict=True))


def recordings_of(app: AppContext, space: CandidateSet, candidate: int) -> tuple[Video, ...]:
    """All recordings of a candidate."""
    clips = space.recordings[candidate]
    there = app.recordings.sizes(list(clips))
    return tuple(video(there, space, candidate, clip) for clip in clips)
