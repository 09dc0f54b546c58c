"""How well a run scattered its waste: g and f (Sec. V-A, Eqs. 13 and 14).

Neither ever reaches the optimiser that learns from preferences: they score what it acquired, and
they drive the simulated evaluators.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .environments import FloatArray


class WeightSeriesError(ValueError):
    """What was given is no weight series."""


def ideal(initial: ArrayLike, samples: int) -> FloatArray:
    """The ideal weight, (..., samples): a straight fall from ``initial`` (...) to 0."""
    start = np.asarray(initial, dtype=np.float64)
    return start[..., None] * np.linspace(1.0, 0.0, samples)


def score(weight: ArrayLike) -> FloatArray:
    """g (Eq. 13): minus the root mean square distance of a run from its own ideal, in grams.

    ``weight`` is (..., samples), evenly sampled from the start of the run to its end; the result
    has the leading axes (0-d for one run). The ideal begins at the run's own first weight.
    """
    series = np.asarray(weight, dtype=np.float64)
    if series.ndim == 0 or series.shape[-1] < 2:
        raise WeightSeriesError(
            f"expected weight series of at least 2 samples, got an array of shape {series.shape}"
        )
    away = series - ideal(series[..., 0], series.shape[-1])
    return np.asarray(-np.sqrt(np.mean(away * away, axis=-1)))


def objective(scores: ArrayLike) -> FloatArray:
    """f (Eq. 14): the mean of g over the runs of each candidate, (..., runs) to (...)."""
    return np.asarray(np.mean(np.asarray(scores, dtype=np.float64), axis=-1))
