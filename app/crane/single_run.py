"""One run of the crane for any parameters and any seed, as a video with its weight series."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .dynamics import simulate
from .environments import environment_named
from .evaluation import score
from .renderer import render


@dataclass(frozen=True)
class RecordedRun:
    """What was measured in a run. score: g, in grams. weight: (501,) at 50 Hz, in grams."""

    score: float
    weight: tuple[float, ...]


def record(environment: str, candidate: tuple[float, float], seed: int, path: Path) -> RecordedRun:
    """Simulate a run and write its video to `path`. The same arguments give the same bytes.

    candidate: opening and closing time in seconds, each from 0 to 10. seed: a non-negative integer.
    Takes up to 1.5 s of CPU.
    """
    run = simulate(environment_named(environment), candidate, np.random.default_rng(seed))
    render(run, path)
    with path.open("rb+") as written:
        os.fsync(written.fileno())
    return RecordedRun(float(score(run.weight)), tuple(round(float(w), 3) for w in run.weight))
