"""The model of several people over all candidates, in the form of one person's belief.

A population's values, and a person's, have the kernel of everybody's, at a share of its variance.
So their posterior given the values in the data says of all other candidates what one person's
would, and everything that is done with a belief is done with theirs.
"""

from collections.abc import Sequence

import numpy as np

from .box_belief import FitToPoints
from .candidates import Candidates, FloatArray, IndexArray
from .model import posterior_over
from .model_averaging import Average, FittedScale, average_over, averaged, length_scales, predicted
from .people_model import PeopleFitter, PeopleModel
from .people_settings import PeopleSettings
from .people_trial import AnyQuery, PeopleTrial
from .point_prior import PointPrior
from .prior import LARGEST_KEPT, Prior, prior_over
from .settings import Settings
from .threshold import prior_with_threshold


def fitter_over(candidates: Candidates, settings: Settings, people: PeopleSettings) -> PeopleFitter:
    """Fits the model to answers that name candidates by their rows."""
    n, dimensions = candidates.points.shape

    def block(length_scale: float, rows: IndexArray) -> FloatArray:
        if n > LARGEST_KEPT:
            prior = PointPrior(candidates.points, length_scale, settings.signal_variance)
            return prior.block(rows)
        return prior_over(candidates, length_scale, settings.signal_variance).block(rows)

    return PeopleFitter(block, length_scales(settings, dimensions), settings, people)


def fitter_at(points: FloatArray, settings: Settings, people: PeopleSettings) -> PeopleFitter:
    """The same for points (n, d), in kernel coordinates, that change from query to query."""

    def block(length_scale: float, rows: IndexArray) -> FloatArray:
        return PointPrior(points, length_scale, settings.signal_variance).block(rows)

    return PeopleFitter(block, length_scales(settings, points.shape[1]), settings, people)


def parts_of(model: PeopleModel, person: str | None, n: int) -> list[FittedScale]:
    """The fits of the population's values, or of a person's."""
    return model.population(n) if person is None else model.person(person, n)


def belief_of(
    candidates: Candidates, model: PeopleModel, person: str | None, settings: Settings
) -> Average:
    """What the model says of every candidate, for the population or for a person."""
    n = len(candidates)
    parts = parts_of(model, person, n)
    if n > LARGEST_KEPT:
        return predicted(candidates.points, parts, settings, model.weights)
    posteriors = []
    for part in parts:
        assert part.learned is not None
        own = prior_over(candidates, part.length_scale, settings.signal_variance)
        whole = prior_with_threshold(own, settings.signal_variance)
        posteriors.append(posterior_over(scaled(whole, n, part.signal, part.extra), part.learned))
    return averaged(posteriors, n, model.weights)


def unlearned_people(candidates: Candidates, settings: Settings) -> Average:
    """The belief before anybody has answered."""
    return average_over(candidates, (), (), settings)


def scaled(prior: Prior, n: int, signal: float, extra: float) -> Prior:
    """The prior with the variance of n candidates and of what is behind them multiplied."""
    if signal == extra == 1.0:
        return prior
    factor = np.sqrt(np.append(np.full(n, signal), np.full(len(prior) - n, extra)))
    return Prior(
        prior.length_scale,
        prior.covariance * factor[:, None] * factor[None, :],
        prior.root * factor[:, None],
    )


def fit_of_people(
    trial: PeopleTrial[AnyQuery],
    person: str | None,
    settings: Settings,
    people: PeopleSettings,
) -> FitToPoints:
    """The fits to several people's answers about points of a box."""

    def fit(seen: FloatArray, below: Sequence[int]) -> tuple[list[FittedScale], FloatArray]:
        model = trial.model(fitter_at(seen, settings, people), below)
        return parts_of(model, person, len(seen)), model.weights

    return fit
