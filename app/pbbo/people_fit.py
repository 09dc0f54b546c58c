"""The variational posterior of a population and its people, by fixed-point steps on the sites.

Person p's latent values are g + e_p: g the population's, e_p the person's own deviation,
independent of each other with covariances A and D. Every answer is a probit observation of one
functional of g + e_p, and the best Gaussian has one precision and one natural mean per answer, its
site, which at the optimum satisfy the equations of `variational`:

    site = -E[l''],    natural mean = E[l'] + site E[u],

with u what the answer sees. They are iterated until they hold. What `variational` solves for all
variables together is eliminated here person by person: given the sites, answers of p tell of g
like Gaussian observations with covariance R = X D X' + sites^-1, so that one step costs one
factorisation of the size of all values and one of the size of each person's answers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from .candidates import FloatArray, IndexArray
from .errors import FitError
from .people_answers import Group, PeopleAnswers
from .probit import expectations

#: Most fixed-point steps of a fit, and the change of a mean, in posterior standard deviations, and
#: of a site, relative, below which it has converged.
STEPS: Final = 200
TOLERANCE: Final = 1e-6
#: Enough for the evidence to choose by, whose error is of second order.
ROUGH: Final = 2e-2
#: A fit that has come this close when steps run out is used.
ACCEPTABLE: Final = 3e-2
#: The share of a step that is taken after one that went further than the one before.
DAMPING: Final = 0.5
#: Sites below this share of the largest possible say nothing and are kept there.
LEAST_SITE: Final = 1e-10


class Scale(NamedTuple):
    """One choice of the kernel and the share: what the prior of all values is.

    covariance: (p, p), of a person's values, population and own together.  common, own: (p,), by
    which share of the variance each value is the population's and the person's own.
    side_variance: prior variance of the inclination to a side.
    """

    covariance: FloatArray
    common: FloatArray
    own: FloatArray
    side_variance: float


@dataclass(frozen=True, eq=False)
class Sites:
    """One group's sites: precision and natural mean of each answer; (k, m) each."""

    precision: FloatArray
    natural: FloatArray


@dataclass(frozen=True, eq=False)
class Summary:
    """What some people's answers say of the population's values, as a Gaussian factor.

    precision: (p, p).  natural: (p,).
    """

    precision: FloatArray
    natural: FloatArray
    bound: float = 0.0

    def widened(self, size: int) -> "Summary":
        """The same factor when values have been added behind."""
        extra = size - len(self.natural)
        if extra == 0:
            return self
        return Summary(np.pad(self.precision, (0, extra)), np.pad(self.natural, (0, extra)))


@dataclass(frozen=True, eq=False)
class Seen:
    """One group at some sites, with the noise of its people in the features.

    features: (k, m, s).  residual: (k, m, m), R without the sites, X D X'.  gain: (k, m, m), the
    precision of what the answers tell of X g.  pull: (k, m), that precision times their targets.
    logdet: (k,).
    """

    features: FloatArray
    residual: FloatArray
    gain: FloatArray
    pull: FloatArray
    logdet: FloatArray


@dataclass(frozen=True, eq=False)
class PeopleFit:
    """The posterior of the population's values: z ~ N(mean, (root root')^-1), g = factor z.

    groups: what each group's answers tell, at the final sites.  bound: the evidence lower bound.
    converged: the last change.
    """

    factor: FloatArray
    mean: FloatArray
    root: FloatArray
    sites: tuple[Sites, ...]
    groups: tuple[Seen, ...]
    bound: float
    converged: float


def residual_of(features: FloatArray, group: Group, scale: Scale, sides: FloatArray) -> FloatArray:
    """X D X' with the inclination to a side; (k, m, m)."""
    own = scale.covariance * np.sqrt(scale.own[:, None] * scale.own[None, :])
    block = gathered(own, group)
    residual = features @ block @ features.transpose(0, 2, 1)
    residual += scale.side_variance * sides[:, :, None] * sides[:, None, :]
    residual *= group.own[:, None, None]
    return residual


def gathered(matrix: FloatArray, group: Group) -> FloatArray:
    """The entries of a matrix (p, p) for each person's values, zero behind them; (k, s, s)."""
    padded = np.pad(matrix, (0, 1))
    values = group.values
    return np.asarray(padded[values[:, :, None], values[:, None, :]])


def seen_at(
    features: FloatArray, residual: FloatArray, sites: Sites, *, logdet: bool = False
) -> Seen:
    """What a group's answers tell of the population at these sites."""
    root = np.sqrt(sites.precision)
    system = root[:, :, None] * residual * root[:, None, :]
    count = system.shape[1]
    system[:, np.arange(count), np.arange(count)] += 1.0
    inverse = np.linalg.inv(system)
    gain = root[:, :, None] * inverse * root[:, None, :]
    target = np.divide(sites.natural, root, out=np.zeros_like(root), where=root > 0.0)
    pull = root * (inverse @ target[:, :, None])[:, :, 0]
    logs = np.linalg.slogdet(system)[1] if logdet else np.zeros(len(system))
    return Seen(features, residual, gain, pull, logs)


def summarised(seen: Seen, group: Group, size: int) -> Summary:
    """A group's answers as a factor of the population's values."""
    precision, natural = np.zeros((size + 1, size + 1)), np.zeros(size + 1)
    weighted = seen.features.transpose(0, 2, 1) @ seen.gain  # (k, s, m)
    blocks = weighted @ seen.features
    pulls = (seen.pull[:, None, :] @ seen.features)[:, 0, :]
    for values, block, pull in zip(group.values, blocks, pulls, strict=True):
        # Where values are repeated they are the dummy, whose entries are zero.
        precision[np.ix_(values, values)] += block
        natural[values] += pull
    return Summary(precision[:size, :size], natural[:size])


def only(seen: Seen, group: Group, rows: NDArray[np.bool_]) -> tuple[Seen, Group]:
    """Some people of a group."""
    return (
        Seen(*(getattr(seen, field.name)[rows] for field in fields(Seen))),
        Group(*(getattr(group, field.name)[rows] for field in fields(Group))),
    )


def total_of(summaries: Sequence[Summary], size: int) -> Summary:
    """The product of several factors."""
    precision, natural = np.zeros((size, size)), np.zeros(size)
    for summary in summaries:
        precision += summary.precision
        natural += summary.natural
    return Summary(precision, natural)


def population_at(
    factor: FloatArray, base: Summary, summary: Summary, used: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) and root (p, p) of the whitened population, g = factor z.

    base: what is known of z without the summary, its precision and natural mean.  used: the values
    that the summary tells of.
    """
    rows = factor[used]
    system = base.precision + rows.T @ (summary.precision[np.ix_(used, used)] @ rows)
    root, info = lapack.dpotrf(system, lower=1, clean=1)
    if info != 0:
        raise FitError(f"people: the precision of {len(system)} values does not factorise")
    natural = base.natural + summary.natural[used] @ rows
    mean, _ = lapack.dpotrs(root, natural, lower=1)
    return mean, root


def base_of(factor: FloatArray, fixed: Summary | None) -> Summary:
    """The prior of z, and what is fixed beside it."""
    size = len(factor)
    if fixed is None:
        return Summary(np.eye(size), np.zeros(size))
    return Summary(np.eye(size) + factor.T @ fixed.precision @ factor, fixed.natural @ factor)


def factor_of(scale: Scale) -> FloatArray:
    """The lower factor of the population's prior covariance; (p, p)."""
    root, info = lapack.dpotrf(scale.covariance, lower=1, clean=1)
    if info != 0:
        raise FitError(f"people: the covariance of {len(root)} values does not factorise")
    # The values behind the points are independent of them: rows may be scaled each by its share.
    return np.asarray(np.sqrt(scale.common)[:, None] * root)


def first_sites(answers: PeopleAnswers) -> tuple[Sites, ...]:
    """Sites to begin with: none of the answers tells anything yet."""
    return tuple(
        Sites(np.zeros_like(group.counts), np.zeros_like(group.counts)) for group in answers.groups
    )


def marginals(
    seen: Seen, group: Group, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What the answers see: mean and variance (k, m); and of the population alone, X g: its mean
    (k, m) and covariance (k, m, m)."""
    values = np.append(mean, 0.0)[group.values]
    at = (seen.features @ values[:, :, None])[:, :, 0]
    spread = seen.features @ gathered(covariance, group) @ seen.features.transpose(0, 2, 1)
    shrink = -seen.residual @ seen.gain  # I - R M
    count = shrink.shape[1]
    shrink[:, np.arange(count), np.arange(count)] += 1.0
    pulled = seen.pull - (seen.gain @ at[:, :, None])[:, :, 0]
    full = at + (seen.residual @ pulled[:, :, None])[:, :, 0]
    variance = np.einsum("kij,kij->ki", shrink @ spread, shrink)
    variance += np.einsum("kij,kji->ki", shrink, seen.residual)
    return full, variance, at, spread


def converge(
    answers: PeopleAnswers,
    scale: Scale,
    noise: FloatArray,
    epsilon: float,
    start: Sequence[Sites] | None = None,
    *,
    fixed: Summary | None = None,
    tolerance: float = TOLERANCE,
) -> PeopleFit:
    """The posterior given the answers, or `FitError`.

    noise: of each person, as a multiple of `epsilon`.  start: sites to begin with.  fixed: what
    people say who are not among the answers, a factor that stays as it is.
    """
    probit_scale = float(np.sqrt(2.0)) * epsilon
    size = answers.size
    factor = factor_of(scale)
    features, residuals = [], []
    for group in answers.groups:
        sharpness = 1.0 / np.append(noise, 1.0)[np.minimum(group.people, len(noise))]
        features.append(group.features * sharpness[:, None, None])
        sides = group.sides * sharpness[:, None]
        residuals.append(residual_of(features[-1], group, scale, sides))
    sites = tuple(start) if start is not None else first_sites(answers)
    base = base_of(factor, fixed)
    used = np.unique(np.concatenate([group.values.ravel() for group in answers.groups]))
    used = used[used < size]
    covariance = np.zeros((size, size))
    change, before, share = np.inf, np.inf, 1.0
    for step in range(STEPS):
        seen = [seen_at(x, r, own) for x, r, own in zip(features, residuals, sites, strict=True)]
        summaries = [
            summarised(one, group, size) for one, group in zip(seen, answers.groups, strict=True)
        ]
        mean, root = population_at(factor, base, total_of(summaries, size), used)
        # Only of the values that these answers name.
        spread, _ = lapack.dtrtrs(root, factor[used].T, lower=1)
        covariance[np.ix_(used, used)] = spread.T @ spread
        at = factor @ mean
        moved, change, parts = [], 0.0, []
        for one, group, own in zip(seen, answers.groups, sites, strict=True):
            told = group.counts > 0.0
            full, variance, _, _ = marginals(one, group, at, covariance)
            variance = np.maximum(variance[told], 1e-300)
            deviation = np.sqrt(variance)
            e = expectations(full[told] / probit_scale, deviation / probit_scale)
            counts = group.counts[told] / probit_scale
            precision, natural = np.zeros_like(full), np.zeros_like(full)
            least = LEAST_SITE * counts / probit_scale
            precision[told] = np.maximum(counts / probit_scale * e.curvature, least)
            natural[told] = counts * e.slope + precision[told] * full[told]
            drift = natural - own.natural - (precision - own.precision) * full
            change = max(
                change,
                float(np.max(np.abs(drift[told]) * deviation, initial=0.0)),
                float(np.max(np.abs(precision - own.precision)[told] * variance, initial=0.0)),
            )
            moved.append(Sites(precision, natural))
            parts.append((full, told, variance, e.value))
        if change < tolerance or step == STEPS - 1:
            break
        # Steps that overshoot are shortened, for good: answers are then few and steep.
        share = max(share * DAMPING, 0.1) if change > before and step > 1 else share
        before = change
        sites = tuple(
            Sites(
                own.precision + share * (new.precision - own.precision),
                own.natural + share * (new.natural - own.natural),
            )
            for own, new in zip(sites, moved, strict=True)
        )
    if not change < ACCEPTABLE:
        raise FitError(
            f"people: expected a change below {ACCEPTABLE:g} after {STEPS} steps, got {change:g}"
        )
    bound = -float(np.log(root.diagonal()).sum())
    for group, x, r, own, (full, told, variance, value) in zip(
        answers.groups, features, residuals, sites, parts, strict=True
    ):
        logdet = seen_at(x, r, own, logdet=True).logdet
        site, natural, centre = own.precision[told], own.natural[told], full[told]
        bound += float(
            group.counts[told] @ value
            - 0.5 * natural @ centre
            + 0.5 * site @ (centre**2 + variance)
            - 0.5 * logdet.sum()
        )
    if not np.isfinite(bound):
        raise FitError("people: the bound is not finite")
    return PeopleFit(factor, mean, root, sites, tuple(seen), bound, change)
