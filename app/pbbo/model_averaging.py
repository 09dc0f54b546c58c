"""One belief from several length scales, each weighted by its evidence.

A long length scale is right on a wide plateau and a short one at a narrow peak, and a few dozen
answers seldom tell which of the two this is. Choosing one early is costly when it is the wrong one;
averaging costs one fit per length scale. The weights are those of Bayesian model averaging under a
prior that favours none, with the evidence lower bound for the log evidence.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from scipy.linalg import lapack

from .candidates import Candidates, FloatArray, IndexArray
from .comparisons import counted
from .errors import FitError
from .model import Fit, Posterior, fitted, posterior_of, posterior_over, unlearned
from .point_prior import PointPrior
from .preferences import Preference
from .prior import LARGEST_KEPT, Prior, prior_over
from .settings import Settings
from .skip_synthesis import Skip
from .threshold import latent_variances, prior_with_threshold, sharpness, with_threshold

Part = TypeVar("Part")

# Raised to the diagonal of a covariance that functions are drawn from, as a share of its largest
# entry: the first that factorises.
DRAW_JITTERS: Final = (1e-9, 1e-7, 1e-5)


@dataclass(frozen=True, eq=False)
class Average:
    """A mixture of posteriors over n candidates and, behind them, the threshold and tie width.

    parts: one for each length scale that could be fitted.  weights: as many, their sum 1.
    mean, std: (n,), of the candidates.  threshold, tie_width: mean and standard deviation.
    """

    parts: tuple[Posterior, ...]
    weights: FloatArray
    mean: FloatArray
    std: FloatArray
    threshold: tuple[float, float]
    tie_width: tuple[float, float]


def joint_draws(
    belief: Posterior | Average, rng: np.random.Generator, count: int, rows: IndexArray
) -> FloatArray:
    """Functions from a posterior or a mixture at these candidates; (rows, count)."""
    parts = belief.parts if isinstance(belief, Average) else (belief,)
    weights = belief.weights if isinstance(belief, Average) else np.ones(1)
    drawn = []
    for part, share in zip(parts, rng.multinomial(count, weights), strict=True):
        if share and isinstance(part.prior, Prior):
            # The prior's factor is at hand: no covariance has to be factorised.
            drawn.append(part.draw(rng, int(share))[rows])
        elif share:
            root = root_of(part.covariance(rows))
            noise = rng.standard_normal((int(share), len(rows))).T
            drawn.append(part.mean[rows][:, None] + root @ noise)
    return np.hstack(drawn)


def root_of(covariance: FloatArray) -> FloatArray:
    """Lower Cholesky factor of a covariance that rounding may have made indefinite."""
    scale = float(np.diagonal(covariance).max())
    for jitter in DRAW_JITTERS:
        raised = covariance + jitter * scale * np.eye(len(covariance))
        root, info = lapack.dpotrf(raised, lower=1, clean=1)
        if info == 0:
            return np.asarray(root)
    raise FitError(f"draw: the covariance of {len(covariance)} candidates does not factorise")


def average_over(
    candidates: Candidates,
    preferences: Sequence[Preference],
    skips: Sequence[Skip],
    settings: Settings,
    excluded: Sequence[int] = (),
) -> Average:
    """What the answers and skips say about the candidates and the threshold, or `FitError`.

    excluded: candidates that lie below the threshold for a reason of their own.
    """
    n, dimensions = candidates.points.shape
    if n > LARGEST_KEPT:
        parts = fitted_parts(candidates.points, preferences, skips, settings, excluded)
        return predicted(candidates.points, parts, settings)

    def prior_at(length_scale: float) -> Prior:
        prior = prior_over(candidates, length_scale, settings.signal_variance)
        return prior_with_threshold(prior, settings.signal_variance)

    comparisons = with_threshold(preferences, skips, n, excluded)
    if not comparisons:
        return averaged(
            [unlearned(prior_at(scale)) for scale in length_scales(settings, dimensions)], n
        )
    tally = counted(comparisons, n + 1)
    noise = sharpness(tally, n, settings.threshold_noise)
    return averaged(
        of_each_scale(
            lambda scale: posterior_of(prior_at(scale), tally, settings.threshold_epsilon, noise),
            length_scales(settings, dimensions),
        ),
        n,
    )


@dataclass(frozen=True, eq=False)
class FittedScale:
    """What was learned at one length scale, from comparisons of n points.

    learned: None if there was nothing to learn from.  signal, extra: prior variance of the points,
    and of the threshold and tie width, as shares of the usual.
    """

    length_scale: float
    n: int
    learned: Fit | None
    signal: float = 1.0
    extra: float = 1.0


def fitted_parts(
    seen: FloatArray,
    preferences: Sequence[Preference],
    skips: Sequence[Skip],
    settings: Settings,
    excluded: Sequence[int] = (),
) -> list[FittedScale]:
    """The fits at all length scales; seen: (n, d), the points that answers name by their rows."""
    n, dimensions = seen.shape
    scales = length_scales(settings, dimensions)
    comparisons = with_threshold(preferences, skips, n, excluded)
    if not comparisons:
        return [FittedScale(scale, n, None) for scale in scales]
    tally = counted(comparisons, n + 1)
    noise = sharpness(tally, n, settings.threshold_noise)
    extra = latent_variances(settings.signal_variance)

    def fit_at(scale: float) -> FittedScale:
        prior = PointPrior(seen, scale, settings.signal_variance, extra)
        covariance = prior.block(tally.seen)
        learned = fitted(covariance, tally, settings.threshold_epsilon, noise)
        return FittedScale(scale, n, learned)

    return of_each_scale(fit_at, scales)


def predicted(
    points: FloatArray,
    parts: Sequence[FittedScale],
    settings: Settings,
    weights: FloatArray | None = None,
) -> Average:
    """What the fits say of these points (k, d), whose first rows are those that were fitted to.

    weights: of the parts, if not those by evidence.
    """
    posteriors = []
    for part in parts:
        signal = part.signal * settings.signal_variance
        extra = latent_variances(part.extra * settings.signal_variance)
        prior = PointPrior(points, part.length_scale, signal, extra)
        if part.learned is None:
            posteriors.append(unlearned(prior))
            continue
        # The threshold and the tie width stay behind the last point.
        seen = part.learned.seen
        seen = np.where(seen < part.n, seen, seen + len(points) - part.n)
        learned = Fit(seen, part.learned.whiten, part.learned.q)
        posteriors.append(posterior_over(prior, learned))
    return averaged(posteriors, len(points), weights)


def length_scales(settings: Settings, dimensions: int) -> list[float]:
    """Length scales are given for two parameters; typical distances grow with the root of how
    many there are."""
    stretch = float(np.sqrt(dimensions / 2.0))
    return [stretch * scale for scale in settings.threshold_length_scales]


def of_each_scale(fit_at: Callable[[float], Part], scales: Sequence[float]) -> list[Part]:
    """What can be fitted; `FitError` if no length scale can."""
    parts: list[Part] = []
    failures: list[str] = []
    for scale in scales:
        try:
            parts.append(fit_at(scale))
        except (FitError, np.linalg.LinAlgError) as error:
            failures.append(f"length scale {scale:g}: {error}")
    if not parts:
        raise FitError(f"average: expected a fit for one length scale at least; {failures}")
    return parts


def averaged(parts: Sequence[Posterior], n: int, weights: FloatArray | None = None) -> Average:
    """The mixture of these posteriors over n candidates, by default weighted by evidence."""
    if weights is None:
        bounds = np.array([part.bound for part in parts])
        weights = np.exp(bounds - bounds.max())
        weights /= weights.sum()
    means = np.array([part.mean for part in parts])  # (parts, n + 2)
    stds = np.array([part.std for part in parts])
    mean = weights @ means
    std = np.sqrt(weights @ (stds**2 + (means - mean) ** 2))
    return Average(
        parts=tuple(parts),
        weights=weights,
        mean=mean[:n],
        std=std[:n],
        threshold=(float(mean[n]), float(std[n])),
        tie_width=(float(mean[n + 1]), float(std[n + 1])),
    )
