"""One belief from several length scales, each weighted by its evidence.

A long length scale is right on a wide plateau and a short one at a narrow peak, and a few dozen
answers seldom tell which of the two this is. Choosing one early is costly when it is the wrong one;
averaging costs one fit per length scale. The weights are those of Bayesian model averaging under a
prior that favours none, with the evidence lower bound for the log evidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.comparisons import tally
from app.pbbo.errors import FitError
from app.pbbo.model import Posterior, posterior_of, unlearned
from app.pbbo.preferences import Preference
from app.pbbo.prior import prior_over
from app.pbbo.settings import Settings
from app.pbbo.synthesis import Skip
from app.pbbo.threshold import prior_with_threshold, sharpness, with_threshold


@dataclass(frozen=True, eq=False)
class Average:
    """A mixture of posteriors over n candidates and, behind them, the threshold.

    parts: one for each length scale that could be fitted.  weights: as many, their sum 1.
    mean, std: (n,), of the candidates.  threshold: mean and standard deviation.
    """

    parts: tuple[Posterior, ...]
    weights: FloatArray
    mean: FloatArray
    std: FloatArray
    threshold: tuple[float, float]

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Functions from the mixture over the candidates; (n, count)."""
        chosen = rng.choice(len(self.parts), size=count, p=self.weights)
        return np.column_stack([self.parts[part].draw(rng, 1)[:-1, 0] for part in chosen])


def average_over(
    candidates: Candidates,
    preferences: Sequence[Preference],
    skips: Sequence[Skip],
    settings: Settings,
) -> Average:
    """What the answers and skips say about the candidates and the threshold, or `FitError`."""
    comparisons = with_threshold(preferences, skips, len(candidates))
    counted = tally(comparisons) if comparisons else None
    # Length scales are given for two parameters; typical distances grow with the root of how many.
    stretch = float(np.sqrt(candidates.points.shape[1] / 2.0))
    parts: list[Posterior] = []
    failures: list[str] = []
    for length_scale in settings.threshold_length_scales:
        try:
            prior = prior_with_threshold(
                prior_over(candidates, stretch * length_scale, settings.signal_variance),
                settings.signal_variance,
            )
            parts.append(
                unlearned(prior)
                if counted is None
                else posterior_of(
                    prior,
                    counted,
                    settings.threshold_epsilon,
                    sharpness(counted, len(candidates), settings.threshold_noise),
                )
            )
        except (FitError, np.linalg.LinAlgError) as error:
            failures.append(f"length scale {length_scale:g}: {error}")
    if not parts:
        raise FitError(f"average: expected a fit for one length scale at least; {failures}")
    return averaged(parts)


def averaged(parts: Sequence[Posterior]) -> Average:
    """The mixture of these posteriors, weighted by evidence."""
    bounds = np.array([part.bound for part in parts])
    weights = np.exp(bounds - bounds.max())
    weights /= weights.sum()
    means = np.array([part.mean for part in parts])  # (parts, n + 1)
    stds = np.array([part.std for part in parts])
    mean = weights @ means
    std = np.sqrt(weights @ (stds**2 + (means - mean) ** 2))
    return Average(
        parts=tuple(parts),
        weights=weights,
        mean=mean[:-1],
        std=std[:-1],
        threshold=(float(mean[-1]), float(std[-1])),
    )
