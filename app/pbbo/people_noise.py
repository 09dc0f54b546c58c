"""How noisy each person's answers are, by the evidence of them given everybody else's.

What the others say of a person's answers is a Gaussian (the posterior without that person's sites),
and how well it foretells the answers is their evidence, for each of a few noises. The evidence is
high for answers that agree with the others', or with each other as a taste of one's own: a person
who differs consistently is not noisy. Only comparisons of two candidates count as evidence, since a
person who never skips is consistent in that and may choose by chance all the same. The noise used
is the geometric mean under the posterior of the noises, which stays near the average for a person
who has answered little.
"""

from typing import Final

import numpy as np

from .candidates import FloatArray
from .people_answers import Group, PeopleAnswers
from .people_fit import PeopleFit, Scale, factor_of, gathered
from .people_settings import PeopleSettings
from .probit import expectations

#: Fixed-point steps of a fit to one person's answers, and the change that ends it.
STEPS: Final = 60
TOLERANCE: Final = 2e-2


def noise_weights(
    answers: PeopleAnswers,
    scale: Scale,
    fit: PeopleFit,
    noise: FloatArray,
    epsilon: float,
    settings: PeopleSettings,
) -> FloatArray:
    """The posterior probability of each noise for each person; (people, noises).

    noise: (people,), the multiples that the fit was made with.
    """
    weights = np.tile(normalised(np.log(settings.noise_prior)), (len(answers.names), 1))
    factor = factor_of(scale)
    whole = np.linalg.solve(fit.root, factor.T)
    covariance, mean = whole.T @ whole, factor @ fit.mean
    for group, seen in zip(answers.groups, fit.groups, strict=True):
        spread = seen.features @ gathered(covariance, group) @ seen.features.transpose(0, 2, 1)
        values = np.append(mean, 0.0)[group.values]
        at = (seen.features @ values[:, :, None])[:, :, 0]
        # The posterior of what the answers see of the population, without these answers.
        count = spread.shape[1]
        system = -spread @ seen.gain
        system[:, np.arange(count), np.arange(count)] += 1.0
        without = np.linalg.solve(system, spread)
        away = np.linalg.solve(system, (at - (spread @ seen.pull[:, :, None])[:, :, 0])[:, :, None])
        people = group.people
        real = people < len(noise)
        used = np.append(noise, 1.0)[np.minimum(people, len(noise))]
        # In units of the average noise.
        cavity = (without + seen.residual) * (used**2)[:, None, None]
        centre = away[:, :, 0] * used[:, None]
        cavity = 0.5 * (cavity + cavity.transpose(0, 2, 1))
        evidence = np.stack(
            [
                local_bound(centre / level, cavity / level**2, group, epsilon)
                for level in settings.noises
            ],
            axis=1,
        )
        found = normalised(evidence + np.log(settings.noise_prior))
        weights[people[real]] = found[real]
    return weights


def normalised(logs: FloatArray) -> FloatArray:
    """Probabilities proportional to the exponentials of these; the last axis sums to 1."""
    raised = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True))


def local_bound(
    centre: FloatArray, covariance: FloatArray, group: Group, epsilon: float
) -> FloatArray:
    """The evidence lower bound of each person's answers, which see a Gaussian; (k,).

    centre: (k, m), its mean.  covariance: (k, m, m).
    """
    probit_scale = float(np.sqrt(2.0)) * epsilon
    told = group.choices
    if not told.any():
        return np.zeros(len(centre))
    counts = group.counts[told] / probit_scale
    precision, natural = np.zeros_like(centre), np.zeros_like(centre)
    count = centre.shape[1]
    diagonal = np.arange(count)
    before, share = np.inf, 1.0
    for step in range(STEPS):
        root = np.sqrt(precision)
        system = root[:, :, None] * covariance * root[:, None, :]
        system[:, diagonal, diagonal] += 1.0
        inverse = np.linalg.inv(system)
        gain = root[:, :, None] * inverse * root[:, None, :]
        shift = natural - precision * centre
        # Posterior covariance times the shift, G (1 + T G)^-1 shift, without dividing by sites.
        moved = (covariance @ shift[:, :, None])[:, :, 0]
        moved = moved - (covariance @ (gain @ moved[:, :, None]))[:, :, 0]
        mean = centre + moved
        variance = covariance[:, diagonal, diagonal] - np.einsum(
            "kij,kij->ki", covariance @ gain, covariance
        )
        width = np.sqrt(np.maximum(variance[told], 1e-300))
        e = expectations(mean[told] / probit_scale, width / probit_scale)
        new_precision, new_natural = np.zeros_like(centre), np.zeros_like(centre)
        new_precision[told] = counts / probit_scale * e.curvature
        new_natural[told] = counts * e.slope + new_precision[told] * mean[told]
        drift = (new_natural - natural - (new_precision - precision) * mean)[told]
        change = float(np.max(np.abs(drift) * width, initial=0.0))
        if change < TOLERANCE or step == STEPS - 1:
            break
        share = max(share * 0.5, 0.1) if change > before and step > 1 else share
        before = change
        precision = precision + share * (new_precision - precision)
        natural = natural + share * (new_natural - natural)
    value = np.zeros_like(centre)
    value[told] = group.counts[told] * e.value
    logdet = np.linalg.slogdet(system)[1]
    # E[log q / p] of the answers: the sites' exponent, less its logarithmic mean under the prior.
    exponent = natural * mean - 0.5 * precision * (mean**2 + np.maximum(variance, 0.0))
    log_mean = (
        (natural * centre - 0.5 * precision * centre**2).sum(axis=1)
        + 0.5 * (shift * moved).sum(axis=1)
        - 0.5 * logdet
    )
    return np.asarray(value.sum(axis=1) - exponent.sum(axis=1) + log_mean)


def effective_noise(weights: FloatArray, settings: PeopleSettings) -> FloatArray:
    """The noise that a person's answers are taken with; (people,).

    Relative to what is expected of anybody, so that who has not answered is average.
    """
    logs = np.log(settings.noises)
    usual = normalised(np.log(settings.noise_prior)) @ logs
    noise = np.exp(weights @ logs - usual)
    return np.asarray(np.clip(noise, settings.noises[0], settings.noises[-1]))
