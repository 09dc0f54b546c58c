"""What the answers of several people say, in numbers to read: the population's best and how sure it
is, each person's own taste and noise, and how much each moves the population's best.

Everything is read from one full fit (`people_model`). The population's values given without a
person are those of the same fit without that person's sites: their answers leave, while noises, r,
length scales and the other people's sites stay as they are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .box import Box
from .box_design import whole
from .candidates import Candidates, FloatArray, IndexArray
from .errors import PersonError
from .people_answers import EVERYBODY, FIRST_POINT, PersonAnswer
from .people_belief import belief_of, fitter_over
from .people_model import KeptFit, PeopleModel
from .people_settings import PeopleSettings
from .people_taste import Kinds, kinds_of, likeness_of
from .point_prior import PointPrior
from .prior import LARGEST_KEPT, Prior, prior_over
from .randomness import Purpose, generator
from .settings import Settings
from .sureness import Landscapes

#: Being better by less than this share of the range of the population's values is no difference.
WITHIN: Final = 0.1
#: Probability of the intervals.
PROBABILITY: Final = 0.9
#: A person is noisy from this multiple of the average noise on.
NOISY: Final = 2.5
#: Of many points in a box, the largest number that the summary is about, besides those shown.
MOST_POINTS: Final = 900


@dataclass(frozen=True)
class Interval:
    """A value, and the two ends of its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class PersonSummary:
    """One person.

    answers, skips: how many.  best: row of their own best candidate.  costs: by how much the
    population's best lies below it in their own values, as a share of the range of these.
    likeness: the correlation of their values with the population's over the candidates.
    own_share: the share of the variance of their values that is their own deviation.  nearest: the
    place of the person whose values correlate most with theirs.  kind: number of their kind of
    taste, if kinds can be told apart.  noise: a multiple of the average.  noisy: the probability
    that it is `NOISY` or more.  threshold: mean, in the units of the values; None where no one
    skipped.  accepted: how many candidates lie above it.  influence: root mean square change of
    the population's values without this person, in standard deviations of these values.
    best_without: row of the population's best without them.  moves: by how much that lies below
    the population's best in everybody's values, as a share of the range.
    """

    name: str
    answers: int
    skips: int
    best: int
    costs: float
    likeness: float
    own_share: float
    nearest: int | None
    kind: int | None
    noise: Interval
    noisy: float
    threshold: float | None
    accepted: int | None
    influence: float
    best_without: int
    moves: float


@dataclass(frozen=True, eq=False)
class PeopleSummary:
    """The population and its people.

    points: (n, d), the candidates; in a box the points shown and points over the whole of it.
    mean, std: (n,), the population's values.  disagreement: (n,), standard deviation of people's
    values about the population's, in the same units.  best_probability: (n,), the share of drawn
    functions that are largest there.  sure: the probability that none is better than `best` by more
    than a tenth of the range.  where: for each parameter, that of `best` with the interval of the
    candidate that is best.  own_share: r.
    """

    points: FloatArray
    mean: FloatArray
    std: FloatArray
    disagreement: FloatArray
    best_probability: FloatArray
    best: int
    sure: float
    where: tuple[Interval, ...]
    own_share: Interval
    kinds: Kinds
    people: tuple[PersonSummary, ...]


def summarise_candidates(
    candidates: Any,
    history: Sequence[PersonAnswer],
    settings: Settings | None = None,
    people: PeopleSettings | None = None,
) -> PeopleSummary:
    """The summary of answers about rows of a list of candidates (n, d). Raises `PbboError`."""
    settings = settings or Settings()
    scaled = Candidates.from_array(candidates, scale=settings.scale_candidates)
    given = np.array(candidates, dtype=np.float64)
    return _summary(given, scaled, history, settings, people or PeopleSettings(), ())


def summarise_box(
    box: Box,
    shown: Any,
    history: Sequence[PersonAnswer],
    settings: Settings | None = None,
    people: PeopleSettings | None = None,
    excluded: Sequence[int] = (),
) -> PeopleSummary:
    """The summary of answers about points of a box. Raises `PbboError`.

    shown: (k, d), different points, which answers name by their rows; they are the first rows of
    the summary's points.  excluded: rows that lie below everybody's threshold.
    """
    settings = settings or Settings()
    points = np.array(shown, dtype=np.float64).reshape(-1, box.dimensions)
    known = set(box.keys(points))
    spread = whole(box, generator(0, Purpose.DESIGN, 0))
    keys = box.keys(spread)
    fresh = spread[[key not in known for key in keys]]
    fresh = fresh[:: -(-len(fresh) // MOST_POINTS) or 1]
    points = np.vstack([points, fresh])
    scaled = Candidates(box.kernel_coordinates(points))
    return _summary(points, scaled, history, settings, people or PeopleSettings(), tuple(excluded))


def _summary(
    points: FloatArray,
    candidates: Candidates,
    history: Sequence[PersonAnswer],
    settings: Settings,
    people: PeopleSettings,
    excluded: tuple[int, ...],
) -> PeopleSummary:
    names = tuple(dict.fromkeys(answer.person for answer in history))
    if len(names) < 2:
        raise PersonError(f"people: expected answers of two people at least, got {len(names)}")
    n = len(candidates)
    model = fitter_over(candidates, settings, people).full_fit(history, excluded)
    belief = belief_of(candidates, model, None, settings)
    reaches = [_reach(candidates, kept, model.points, settings) for kept in model.fits]
    weights = model.weights
    free = np.ones(n, dtype=np.bool_)
    free[list(excluded)] = False
    best = _largest(belief.mean, free)
    span = _range(belief.mean)

    own = np.empty((len(names), n))
    thresholds = np.empty(len(names))
    for place, name in enumerate(names):
        means = [model.values_of(kept, name)[0] for kept in model.fits]
        own[place] = weights @ [
            reach @ mean[FIRST_POINT:] for reach, mean in zip(reaches, means, strict=True)
        ]
        thresholds[place] = weights @ [mean[0] for mean in means]
    without = np.zeros((len(names), n))
    for weight, kept, reach in zip(weights, model.fits, reaches, strict=True):
        for number, mean in _without_each(model, kept):
            without[number] += weight * (reach @ mean[FIRST_POINT:])

    landscapes = Landscapes(
        belief, np.arange(n), best, generator(0, Purpose.SURENESS, len(history))
    )
    inside = free[landscapes.rows]
    values = np.where(inside[:, None], landscapes.values, -np.inf)
    winners = landscapes.rows[np.argmax(values, axis=0)]
    probability = np.bincount(winners, minlength=n) / len(winners)
    tails = (0.5 - PROBABILITY / 2, 0.5 + PROBABILITY / 2)
    ends = np.quantile(points[winners], tails, axis=0, method="nearest")
    where = tuple(
        Interval(value, min(value, low), max(value, high))
        for value, low, high in zip(
            points[best].tolist(), ends[0].tolist(), ends[1].tolist(), strict=True
        )
    )
    alike = likeness_of(own)
    kinds = kinds_of(alike, float(model.share_weights[np.array(people.own_shares) > 0.0].sum()))
    skipped = any(answer.response == "skip" for answer in history)
    spread = float(np.std(belief.mean)) or 1.0
    found = []
    for place, name in enumerate(names):
        mine = own[place]
        my_best = _largest(mine, free)
        deviation = mine - belief.mean
        best_without = _largest(without[place], free)
        given = [answer for answer in history if answer.person == name]
        others = np.where(np.arange(len(names)) == place, -np.inf, alike[place])
        found.append(
            PersonSummary(
                name=name,
                answers=len(given),
                skips=sum(answer.response == "skip" for answer in given),
                best=my_best,
                costs=float(mine[my_best] - mine[best]) / _range(mine),
                likeness=_correlation(mine, belief.mean),
                own_share=float(np.var(deviation) / (np.var(deviation) + spread**2)),
                nearest=int(np.argmax(others)),
                kind=None if kinds.number < 2 else kinds.of[place],
                noise=_noise(model, place, people),
                noisy=float(model.noise_weights[place][np.array(people.noises) >= NOISY].sum()),
                threshold=float(thresholds[place]) if skipped else None,
                accepted=int(np.sum(mine > thresholds[place])) if skipped else None,
                influence=float(np.sqrt(np.mean((belief.mean - without[place]) ** 2))) / spread,
                best_without=best_without,
                moves=float(belief.mean[best] - belief.mean[best_without]) / span,
            )
        )
    return PeopleSummary(
        points=points,
        mean=belief.mean,
        std=belief.std,
        disagreement=np.sqrt(np.mean((own - belief.mean) ** 2, axis=0)),
        best_probability=probability,
        best=best,
        sure=landscapes.sureness(best, WITHIN),
        where=where,
        own_share=_discrete(people.own_shares, model.share_weights),
        kinds=kinds,
        people=tuple(found),
    )


def _reach(
    candidates: Candidates, kept: KeptFit, seen: IndexArray, settings: Settings
) -> FloatArray:
    """What takes values at the points seen to their expectation at all candidates; (n, p)."""
    prior: Prior | PointPrior
    if len(candidates) > LARGEST_KEPT:
        prior = PointPrior(candidates.points, kept.length_scale, settings.signal_variance)
    else:
        prior = prior_over(candidates, kept.length_scale, settings.signal_variance)
    factor = cho_factor(prior.block(seen), lower=True)
    return np.asarray(cho_solve(factor, prior.columns(seen).T).T)


def _without_each(model: PeopleModel, kept: KeptFit) -> Iterator[tuple[int, FloatArray]]:
    """For each person the mean of the population's values at the points, (p,), without them."""
    fit = kept.fit
    precision = fit.root @ fit.root.T
    natural = precision @ fit.mean
    rows = np.vstack([fit.factor, np.zeros(len(fit.factor))])
    for group, seen in zip(model.answers.groups, fit.groups, strict=True):
        for k, number in enumerate(group.people):
            if number == EVERYBODY:
                continue
            told = seen.features[k] @ rows[group.values[k]]  # (m, p)
            factor = cho_factor(precision - told.T @ seen.gain[k] @ told, lower=True)
            mean = cho_solve(factor, natural - told.T @ seen.pull[k])
            yield int(number), fit.factor @ mean


def _noise(model: PeopleModel, place: int, people: PeopleSettings) -> Interval:
    """A person's noise, with the interval of the multiples that it was chosen from."""
    ends = _discrete(people.noises, model.noise_weights[place])
    value = float(model.noise[place])
    return Interval(value, min(value, ends.low), max(value, ends.high))


def _discrete(values: Sequence[float], weights: FloatArray) -> Interval:
    """Mean and interval of a distribution over a few values."""
    reached = np.cumsum(weights) / np.sum(weights)
    low, high = (
        values[min(int(np.searchsorted(reached, share)), len(values) - 1)]
        for share in (0.5 - PROBABILITY / 2, 0.5 + PROBABILITY / 2)
    )
    return Interval(float(np.dot(weights, values) / np.sum(weights)), low, high)


def _largest(values: FloatArray, free: np.ndarray[Any, np.dtype[np.bool_]]) -> int:
    return int(np.argmax(np.where(free, values, -np.inf)))


def _range(values: FloatArray) -> float:
    return float(np.ptp(values)) or 1.0


def _correlation(first: FloatArray, second: FloatArray) -> float:
    return float(likeness_of(np.stack([first, second]))[0, 1])
