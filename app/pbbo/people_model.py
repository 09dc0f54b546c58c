"""The belief about a population and its people from everybody's answers.

Length scales and the share of taste that is people's own are averaged over by evidence, as length
scales are for one person; noises are chosen per person (`people_noise`). A full fit chooses all of
these. Between two full fits, whose moments depend on the number of answers alone, the people who
answered since the last summary are fitted again and the others stay a Gaussian factor; every few
answers what was fitted again becomes part of the summary. A step then costs as much with two
hundred people as with twenty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.linalg import lapack

from .candidates import FloatArray, IndexArray
from .errors import FitError
from .model import Fit
from .model_averaging import FittedScale
from .people_answers import (
    FIRST_POINT,
    PeopleAnswers,
    PersonAnswer,
    people_answers,
    points_of,
)
from .people_fit import (
    ROUGH,
    PeopleFit,
    Scale,
    Sites,
    Summary,
    converge,
    only,
    summarised,
    total_of,
)
from .people_noise import effective_noise, noise_weights, normalised
from .people_settings import LEAST_COMMON, PeopleSettings
from .settings import Settings
from .threshold import latent_variances
from .variational import Gaussian

#: Rounds of choosing the share and the noises in turn.
ROUNDS: Final = 2
#: A choice of length scale and share that weighs less than this beside the best is not kept.
LEAST_KEPT: Final = 0.05
#: So many are kept at most.
MOST_KEPT: Final = 4
#: Between two full fits of more answers than this, so many of them go on.
MANY_ANSWERS: Final = 200
MOST_UPDATED: Final = 2
#: So many length scales, the best at the first look, are looked at with every share.
MOST_LENGTHS: Final = 2
#: A share that weighs less than this at the last look is not looked at with every length scale.
LEAST_SHARE: Final = 0.01
#: The tolerance of a fit that is kept, and of one between two full fits.
CLOSE: Final = 1e-3
UPDATED: Final = 1e-2

#: The prior covariance of points named by their rows, at a length scale, for signal variance 1.
Block = Callable[[float, IndexArray], FloatArray]


@dataclass(frozen=True, eq=False)
class KeptFit:
    """One kept choice of the hyperparameters, fitted.

    length_scale, own_share: the choice.  scale: its prior.  fit: the posterior.  rest: what people
    say who were not fitted again.
    """

    length_scale: float
    own_share: float
    scale: Scale
    fit: PeopleFit
    rest: Summary | None = None


@dataclass(frozen=True, eq=False)
class PeopleModel:
    """What everybody's answers say.

    answers: those that `fits` fitted: of everybody, or of those who answered since the last
    summary.  noise: (people,).  noise_weights: (people, noises).  share_weights: (own_shares,), the
    posterior of r.  fits, weights: the kept choices.  before: the last summary, None of a full fit.
    later: summaries after a full fit, by the answers since; they are computed once.
    """

    names: tuple[str, ...]
    points: IndexArray
    answers: PeopleAnswers
    noise: FloatArray
    noise_weights: FloatArray
    share_weights: FloatArray
    fits: tuple[KeptFit, ...]
    weights: FloatArray
    before: "PeopleModel | None" = None
    later: "dict[tuple[PersonAnswer, ...], PeopleModel]" = field(default_factory=dict, repr=False)

    def population(self, n: int) -> list[FittedScale]:
        """The fits of the population's values, of n points named by row."""
        return [
            FittedScale(
                kept.length_scale,
                n,
                Fit(
                    numbers(self.points, n),
                    inverse_factor(kept.fit.factor),
                    Gaussian(kept.fit.mean, kept.fit.root, np.zeros(0), kept.fit.bound),
                ),
                signal=float(kept.scale.common[-1]),
                extra=float(kept.scale.common[0]),
            )
            for kept in self.fits
        ]

    def person(self, name: str, n: int) -> list[FittedScale]:
        """The fits of a person's own values, of n points named by row."""
        found = []
        for kept in self.fits:
            mean, covariance = self.values_of(kept, name)
            root, info = lapack.dpotrf(kept.scale.covariance, lower=1, clean=1)
            whiten = inverse_factor(root)
            spread = whiten @ covariance @ whiten.T
            precision = np.linalg.inv(0.5 * (spread + spread.T))
            lower, failed = lapack.dpotrf(0.5 * (precision + precision.T), lower=1, clean=1)
            if info != 0 or failed != 0:
                raise FitError("people: the posterior of a person's values does not factorise")
            q = Gaussian(whiten @ mean, lower, np.zeros(0), kept.fit.bound)
            found.append(FittedScale(kept.length_scale, n, Fit(numbers(self.points, n), whiten, q)))
        return found

    def values_of(self, kept: KeptFit, name: str) -> tuple[FloatArray, FloatArray]:
        """Mean (p,) and covariance (p, p) of a person's threshold, tie width and points."""
        scale, fit = kept.scale, kept.fit
        whole, _ = lapack.dtrtrs(fit.root, fit.factor.T, lower=1)
        mean, covariance = fit.factor @ fit.mean, whole.T @ whole
        own = scale.covariance * np.sqrt(scale.own[:, None] * scale.own[None, :])
        told = self._told_by(kept, name, len(mean))
        if told is None:
            return mean, covariance + own
        features, gain, pull = told
        reach = own @ features.T  # (p, m)
        carried = reach @ gain
        shrink = np.eye(len(mean)) - carried @ features
        moved = mean + reach @ (pull - gain @ (features @ mean))
        return moved, shrink @ covariance @ shrink.T + own - carried @ reach.T

    def _told_by(
        self, kept: KeptFit, name: str, size: int
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """A person's functionals (m, p), and the precision and pull of what they tell."""
        number = self.names.index(name) if name in self.names else -1
        for group, seen in zip(self.answers.groups, kept.fit.groups, strict=True):
            places = np.flatnonzero(group.people == number)
            if len(places):
                k = int(places[0])
                features = np.zeros((seen.features.shape[1], size + 1))
                # Behind a person's values the number of no value is repeated, with zeros.
                values = np.minimum(group.values[k], size)
                features[:, values] = seen.features[k]
                return features[:, :size], seen.gain[k], seen.pull[k]
        if self.before is None:
            return None
        earlier = self.before.fits[self.fits.index(kept)]
        return self.before._told_by(earlier, name, size)

    def said_without(self, place: int, again: frozenset[int], size: int) -> Summary:
        """What everybody but these people says, under the kept choice at this place: a factor of
        so many values."""
        kept = self.fits[place]
        said = [] if kept.rest is None else [kept.rest.widened(size)]
        here: set[int] = set()
        for group, seen in zip(self.answers.groups, kept.fit.groups, strict=True):
            stays = np.array([int(number) not in again for number in group.people])
            here.update(int(number) for number in group.people)
            if stays.any():
                part = summarised(*only(seen, group, stays), self.answers.size)
                said.append(part.widened(size))
        total = total_of(said, size)
        if self.before is None or kept.rest is None:
            return total
        earlier = self.before.said_by(place, again - here, size)
        return Summary(total.precision - earlier.precision, total.natural - earlier.natural)

    def said_by(self, place: int, people: frozenset[int], size: int) -> Summary:
        """What these people say, each when they were last fitted."""
        said = []
        here: set[int] = set()
        groups = self.answers.groups if people else ()
        for group, seen in zip(groups, self.fits[place].fit.groups, strict=False):
            asked = np.array([int(number) in people for number in group.people])
            here.update(int(number) for number in group.people[asked])
            if asked.any():
                part = summarised(*only(seen, group, asked), self.answers.size)
                said.append(part.widened(size))
        if self.before is not None and people - here:
            said.append(self.before.said_by(place, people - here, size))
        return total_of(said, size)


def numbers(points: IndexArray, n: int) -> IndexArray:
    """The numbers of threshold, tie width and points as `threshold` has them, behind n points."""
    return np.concatenate([np.array([n, n + 1], dtype=np.intp), points])


def inverse_factor(factor: FloatArray) -> FloatArray:
    """The inverse of a lower factor."""
    whiten, _ = lapack.dtrtri(factor, lower=1)
    return np.asarray(whiten)


class PeopleFitter:
    """Fits the model to a history.

    block: the prior covariance of points.  length_scales: those averaged over.
    """

    def __init__(
        self,
        block: Block,
        length_scales: Sequence[float],
        settings: Settings,
        people: PeopleSettings,
    ) -> None:
        self._block = block
        self._length_scales = list(length_scales)
        self._settings = settings
        self._people = people

    def fitted(
        self,
        history: Sequence[PersonAnswer],
        excluded: Sequence[int] = (),
        full: PeopleModel | None = None,
    ) -> PeopleModel:
        """The belief after these answers, at least one, or `FitError`.

        full: the last full fit, if it was kept: that of the first
        `PeopleSettings.last_full_fit(len(history))` answers.
        """
        first = self._people.last_full_fit(len(history))
        if full is None:
            full = self.full_fit(history[:first], excluded)
        if first == len(history):
            return full
        before, at = full, first
        for count in self._people.summaries(len(history)):
            since = tuple(history[first:count])
            if since not in full.later:
                full.later[since] = self._updated(before, history[:count], at, excluded)
            before, at = full.later[since], count
        return before if at == len(history) else self._updated(before, history, at, excluded)

    def scale(self, length_scale: float, own_share: float, points: IndexArray) -> Scale:
        """The prior of all values at one choice of length scale and share."""
        size = len(points) + FIRST_POINT
        covariance = np.zeros((size, size))
        signal = self._settings.signal_variance
        covariance[FIRST_POINT:, FIRST_POINT:] = self._block(length_scale, points)
        covariance[range(FIRST_POINT), range(FIRST_POINT)] = latent_variances(signal)
        own = np.full(size, own_share)
        own[:FIRST_POINT] = self._people.own_thresholds
        common = np.maximum(1.0 - own, LEAST_COMMON)
        return Scale(covariance, common, own, self._people.side_variance * signal)

    def answers_of(
        self,
        history: Sequence[PersonAnswer],
        excluded: Sequence[int],
        points: Sequence[int] | None = None,
        only: frozenset[str] | None = None,
    ) -> PeopleAnswers:
        """The answers of a history, as the fit sees them."""
        return people_answers(
            history,
            self._settings.threshold_noise,
            shared_ties=self._people.own_thresholds < 1.0,
            excluded=excluded,
            points=points,
            only=only,
        )

    def full_fit(
        self, history: Sequence[PersonAnswer], excluded: Sequence[int] = ()
    ) -> PeopleModel:
        """Everything chosen and fitted afresh."""
        answers = self.answers_of(history, excluded)
        people, epsilon = self._people, self._settings.threshold_epsilon
        noise = np.ones(len(answers.names))
        weights = np.tile(np.array(people.noise_prior), (len(noise), 1))
        shares = people.own_shares
        middle = shares[len(shares) // 3]
        start: tuple[Sites, ...] | None = None
        share = middle

        def fit_at(length: float, share: float, tolerance: float) -> PeopleFit:
            nonlocal start
            scale = self.scale(length, share, answers.points)
            try:
                fit = converge(answers, scale, noise, epsilon, start, tolerance=tolerance)
            except FitError:
                fit = converge(answers, scale, noise, epsilon, tolerance=tolerance)
            start = fit.sites
            return fit

        def bounds_at(choices: Sequence[tuple[float, float]]) -> FloatArray:
            found, failure = [], None
            for length, share in choices:
                try:
                    found.append(fit_at(length, share, ROUGH).bound)
                except (FitError, np.linalg.LinAlgError) as error:
                    failure = error
                    found.append(-np.inf)
            if failure is not None and not np.isfinite(max(found)):
                raise FitError(f"people: expected one fit at least; {failure}")
            return np.array(found)

        by_length = bounds_at([(length, middle) for length in self._length_scales])
        order = np.argsort(-by_length, kind="stable")
        lengths = [self._length_scales[int(place)] for place in order[:MOST_LENGTHS]]
        hopeful = list(shares)
        for _ in range(ROUNDS if len(answers.names) > 1 else 0):
            by_share = bounds_at([(lengths[0], one) for one in hopeful])
            share = hopeful[int(np.argmax(by_share))]
            if len(people.noises) > 1:
                fit = fit_at(lengths[0], share, ROUGH)
                scale = self.scale(lengths[0], share, answers.points)
                weights = noise_weights(answers, scale, fit, noise, epsilon, people)
                noise = effective_noise(weights, people)
            likely = normalised(by_share) >= LEAST_SHARE
            hopeful = [one for one, keep in zip(hopeful, likely, strict=True) if keep]
        choices = [(length, one) for length in lengths for one in hopeful]
        log_weights = bounds_at(choices) if len(choices) > 1 else np.zeros(1)
        posterior = normalised(log_weights)
        by_share = np.zeros(len(shares))
        for weight, (_, one) in zip(posterior, choices, strict=True):
            by_share[shares.index(one)] += weight
        order = np.argsort(-posterior, kind="stable")[:MOST_KEPT]
        order = order[posterior[order] >= LEAST_KEPT * posterior[order[0]]]
        kept = []
        for place in order:
            one, share = choices[int(place)]
            kept.append(
                KeptFit(
                    one,
                    share,
                    self.scale(one, share, answers.points),
                    fit_at(one, share, CLOSE),
                )
            )
        chosen = posterior[order] / posterior[order].sum()
        return PeopleModel(
            answers.names,
            answers.points,
            answers,
            noise,
            weights,
            by_share,
            tuple(kept),
            chosen,
        )

    def _updated(
        self,
        before: PeopleModel,
        history: Sequence[PersonAnswer],
        first: int,
        excluded: Sequence[int],
    ) -> PeopleModel:
        """The model of the first answers, with those after them, of the people who gave these."""
        recent = frozenset(answer.person for answer in history[first:])
        points = [int(row) for row in before.points]
        known = set(points)
        points += [row for row in points_of(history, excluded) if row not in known]
        answers = self.answers_of(history, excluded, points, recent)
        noise = np.append(before.noise, np.ones(len(answers.names) - len(before.names)))
        prior = np.array(self._people.noise_prior)
        weights = np.vstack(
            [before.noise_weights, *[prior[None]] * (len(noise) - len(before.noise_weights))]
        )
        again = frozenset(number for number, name in enumerate(answers.names) if name in recent)
        kept = []
        going_on = before.fits if first <= MANY_ANSWERS else before.fits[:MOST_UPDATED]
        for place, one in enumerate(going_on):
            rest = before.said_without(place, again, answers.size)
            scale = self.scale(one.length_scale, one.own_share, answers.points)
            fit = converge(
                answers,
                scale,
                noise,
                self._settings.threshold_epsilon,
                fixed=rest,
                tolerance=UPDATED,
            )
            kept.append(KeptFit(one.length_scale, one.own_share, scale, fit, rest))
        return PeopleModel(
            answers.names,
            answers.points,
            answers,
            noise,
            weights,
            before.share_weights,
            tuple(kept),
            before.weights[: len(kept)] / before.weights[: len(kept)].sum(),
            before,
        )
