"""g of many fresh runs of every candidate of a crane, and their mean: the true f.

The five recorded runs of a candidate differ by some 14 g, so their mean has a standard error of
6 g, and the largest of 231 such means is the luckiest. Regret on them has a floor that hides
differences between optimisers. f here is the mean of g over `RUNS` fresh seeded runs, with a
standard error below 1 g, and evaluators see one of those runs at random, as they would see a new
run of a machine.

They are kept in a folder outside version control, each file named by a hash of what determines it:
the constants, the candidates and one run of each candidate, so that runs of another simulator are
never taken for these.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from pathlib import Path
from typing import Final

import numpy as np

from app.crane.environments import Environment, FloatArray, candidates

from .fast_runs import runs_at_once

#: Fresh runs of each candidate.
RUNS: Final = 400
#: Fixes every fresh run; apart from the seed of the recorded library.
FRESH_SEED: Final = 20261129
#: Where fresh runs are kept, unless the environment variable names another folder.
CACHE_VARIABLE: Final = "PBPO_LAB_CACHE"
DEFAULT_CACHE: Final = "build/lab"


def cache_folder() -> Path:
    """The folder of kept runs: `PBPO_LAB_CACHE`, or build/lab below the working directory."""
    return Path(os.environ.get(CACHE_VARIABLE, DEFAULT_CACHE))


def runs_of(
    environment: Environment, candidate: tuple[float, float], stream: int, count: int
) -> FloatArray:
    """g of `count` seeded runs of one candidate, in grams; (count,). Always the same for the same
    arguments."""
    return runs_at_once(environment, candidate, np.random.default_rng([FRESH_SEED, stream]), count)


def fresh_scores(
    environment: Environment, runs: int = RUNS, folder: Path | None = None
) -> FloatArray:
    """g of fresh runs of every candidate, in grams; (231, runs). Read from the folder if kept."""
    space = [(float(w0), float(w1)) for w0, w1 in candidates()]
    path = (folder or cache_folder()) / f"{digest(environment, runs)}.npy"
    if path.is_file():
        kept: FloatArray = np.load(path)
        return kept
    scores = np.array([runs_of(environment, w, stream, runs) for stream, w in enumerate(space)])
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.{uuid.uuid4().hex}.npy")
    np.save(part, scores)
    part.replace(path)
    return scores


def digest(environment: Environment, runs: int) -> str:
    """A hash of what determines the fresh runs of an environment."""
    space = candidates()
    first = [runs_of(environment, (float(a), float(b)), k, 1) for k, (a, b) in enumerate(space)]
    parts = (repr(environment), runs, FRESH_SEED, space.tobytes(), np.array(first).tobytes())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]
