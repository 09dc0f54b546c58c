"""All recorded runs of the crane world: five seeded runs of each candidate (Sec. V-C).

A run's video is made when it is first asked for. It is named by its content, so that one folder
serves every study, an old video is never taken for a new one, and no name tells a candidate.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from functools import cache
from pathlib import Path

import numpy as np

from .dynamics import Run, simulate
from .environments import FloatArray, candidates, environment_named, run_rng
from .evaluation import score
from .renderer import RENDERER_VERSION, fingerprint, render

RUNS_PER_CANDIDATE = 5
VIDEO_NAME_DIGITS = 32  # hexadecimal; 128 bits tell every video there will be apart


class UnknownRecordingError(LookupError):
    """The library holds no such run."""


def run(environment: str, candidate_index: int, run_index: int) -> Run:
    """The recorded run ``run_index`` of a candidate: the same bytes each time."""
    space = candidates()
    for name, index, count in (
        ("candidate", candidate_index, len(space)),
        ("run", run_index, RUNS_PER_CANDIDATE),
    ):
        if not 0 <= index < count:
            raise UnknownRecordingError(
                f"expected a {name} index from 0 to {count - 1}, got {index!r}"
            )
    w0, w1 = space[candidate_index]
    rng = run_rng(environment, candidate_index, run_index)
    return simulate(environment_named(environment), (float(w0), float(w1)), rng)


@cache
def series(environment: str) -> FloatArray:
    """The weight series of all runs, (231, 5, 501), in grams."""
    weights = np.array(
        [
            [run(environment, index, k).weight for k in range(RUNS_PER_CANDIDATE)]
            for index in range(len(candidates()))
        ]
    )
    weights.setflags(write=False)
    return weights


@cache
def scores(environment: str) -> FloatArray:
    """g of all runs, (231, 5)."""
    values = score(series(environment))
    values.setflags(write=False)
    return values


def video_name(environment: str, candidate_index: int, run_index: int) -> str:
    """The file name of a run's video: it follows from the run's arrays and the renderer alone."""
    return _video_name(run(environment, candidate_index, run_index))


def ensure_video(environment: str, candidate_index: int, run_index: int, media_dir: Path) -> Path:
    """The video of a run in a folder, made now if it is not there. Takes up to 1.5 s of CPU.

    The video appears under its name only when it is whole and on the disk. Two that make the same
    one at once each write their own file, and put the same bytes in place.
    """
    recorded = run(environment, candidate_index, run_index)
    path = media_dir / _video_name(recorded)
    if path.is_file():
        return path
    media_dir.mkdir(parents=True, exist_ok=True)
    part = media_dir / f".{path.stem}.{uuid.uuid4().hex}.part"
    try:
        render(recorded, part)
        with part.open("rb+") as written:
            os.fsync(written.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path


def _video_name(recorded: Run) -> str:
    digest = hashlib.sha256(fingerprint(recorded) + RENDERER_VERSION.encode())
    return f"{digest.hexdigest()[:VIDEO_NAME_DIGITS]}.mp4"
