"""The variational posterior under probit answers: full covariance, maximal ELBO (Eq. 10, 11).

Works on whitened variables z ~ N(0, I_r): the latent values are f = L z with L L' the prior
covariance, and answer i sees one linear functional of them, x_i' z, as a probit observation. For
preferences the functional is a difference of two latent values, but nothing here depends on that.

The best Gaussian q(z) = N(mean, S) has S^-1 = I + X' diag(sites) X: one precision per answer
(Opper and Archambeau 2009), so the r(r+1)/2 numbers of a full covariance are m. The bound is

    sum_i E_q[log Phi(x_i' z / scale)] - (log|S^-1| - sum_i sites_i v_i + |mean|^2) / 2,

v_i = x_i' S x_i. (Eq. 11 as printed has the sign of log|K| / 2 turned and counts queries where it
should count latent values; in whitened form both cancel.) Its stationary point satisfies

    mean = X' slope(mean, v),    sites = curvature(mean, v),

and is found by Newton's method on both together, the sites in logarithms, with the bound as the
measure of progress. A small scale makes the problem stiff, so the scale is lowered in stages, each
started from the one before.
"""

from dataclasses import dataclass
from math import ceil, isfinite, log, sqrt
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import blas, lapack

from .candidates import FloatArray
from .errors import FitError
from .probit import expectations

# The first stage's scale as a share of the prior's widest standard deviation, and its sites as
# multiples of the prior's precision of what an answer sees. Larger scales need more stages, much
# smaller ones more steps in the first.
FIRST_SCALE: Final = 0.07
FIRST_SITE: Final = 2.0
# Ratio of the scales of successive stages, and the one for a second try where the first stalls. 4
# to 6 need the fewest steps in total.
STAGE_RATIO: Final = 5.0
CAUTIOUS_RATIO: Final = 1.7
# With which power of 1 / scale a site grows. With the square where the likelihood is a parabola for
# all that q knows, as between contradictory answers, and then for good; elsewhere, as measured on
# sixteen histories, the more slowly the smaller a share of the largest it is (`growth_of`).
FASTEST_GROWTH: Final = 2.0
SLOWEST_FAST: Final = 1.4
SLOW_GROWTH: Final = 1.3
# Stages before the last need no more than a start for the next.
ROUGH: Final = 0.6
# On the last: about how far a mean may lie from its optimum, in posterior standard deviations.
TOLERANCE: Final = 1e-5
# A fit that stalls in rounding noise is still a fit if it stalls this close.
ACCEPTABLE: Final = 3e-2
STEPS: Final = 60
# The mean alone is moved until Newton's method promises no more than this of the bound, and then
# once more: with the mean further off, joint steps go astray.
MEAN_GAIN: Final = 0.3
MEAN_STEPS: Final = 8
# Relative change of the bound that rounding alone can cause.
ROUNDING: Final = 1e-9
# Most a site may change in one step: a factor of e^5.
LONGEST_STEP: Final = 5.0
# How the equations of a Newton step are solved, by the number of answers; see `solve_sites`.
FEW: Final = 100
VERY_MANY: Final = 500
VERY_MANY_PER_VARIABLE: Final = 3
# Where iteratively: to within a share of the residual, since a better direction of a step that is
# itself only so good would not be a better step.
SOLVED: Final = 0.03
SOLVED_SHARE: Final = 0.1
MOST_DIRECTIONS: Final = 30
# A site this small next to the prior's precision says nothing; below it, logarithms would chase
# answers that the others already imply.
NEGLIGIBLE: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Answers:
    """What q is fitted to.

    features: (m, r), row i the functional answer i sees, of the whitened latent variables.
    counts: (m,), how often the same answer was given.
    scale: the probit's noise, sqrt(2) epsilon.
    """

    features: FloatArray
    counts: FloatArray
    scale: float


@dataclass(frozen=True, eq=False)
class Gaussian:
    """q(z) = N(mean, S), S^-1 = root root'.

    mean: (r,);  root: (r, r) lower triangular;  sites: (m,) precisions;  bound: the ELBO.
    """

    mean: FloatArray
    root: FloatArray
    sites: FloatArray
    bound: float


class State(NamedTuple):
    """q at some (mean, sites), with the bound's derivatives there.

    spread: (r, m), spread' spread is q's covariance of what the answers see.  variance: (m,), its
    diagonal.  gradient: (r,), of the bound in the mean.  slope, curvature, third, fourth: (m,),
    expected derivatives of the answers' log-likelihoods in what they see; the curvature is -E[l''].
    """

    q: Gaussian
    spread: FloatArray
    variance: FloatArray
    gradient: FloatArray
    slope: FloatArray
    curvature: FloatArray
    third: FloatArray
    fourth: FloatArray


def fit(answers: Answers) -> Gaussian:
    """The Gaussian that maximises the bound, or `FitError`."""
    prior_variance = np.einsum("ij,ij->i", answers.features, answers.features)
    if not len(prior_variance) or not np.isfinite(prior_variance).all():
        raise FitError(
            f"fit: expected finite functionals of the latent values, got {prior_variance}"
        )
    if prior_variance.min() <= 0.0:
        raise FitError("fit: expected functionals that vary under the prior, got a constant one")
    try:
        return fit_in_stages(answers, prior_variance, STAGE_RATIO)
    except FitError:
        return fit_in_stages(answers, prior_variance, CAUTIOUS_RATIO)


def fit_in_stages(answers: Answers, prior_variance: FloatArray, ratio: float) -> Gaussian:
    """The fit at falling scales, each started from the one before; prior_variance: (m,)."""
    floor = NEGLIGIBLE / prior_variance
    mean = np.zeros(answers.features.shape[1])
    sites = FIRST_SITE / prior_variance
    grown = np.zeros_like(sites)
    scales = stages(FIRST_SCALE * sqrt(float(prior_variance.max())), answers.scale, ratio)
    for number, scale in enumerate(scales):
        stage = Answers(answers.features, answers.counts, scale)
        start = sites
        if number > 0:
            fall = log(scales[number - 1] / scale)
            share = sites * scales[number - 1] ** 2 / answers.counts
            start = sites * np.exp(fall * growth_of(share, grown))
        start = np.minimum(start, largest_sites(stage))
        known = widths(stage.features, start)
        if known is not None:
            mean = move_mean(stage, mean, known.variance)
        last = number == len(scales) - 1
        tolerance = TOLERANCE if last else ROUGH
        state = ascend(stage, evaluate(stage, mean, start, known), floor, tolerance, strict=last)
        mean = state.q.mean
        if number > 0:
            grown = np.log((state.q.sites + floor) / (sites + floor)) / fall
        sites = state.q.sites
    return state.q


def growth_of(share: FloatArray, before: FloatArray) -> FloatArray:
    """With which power of the falling scale a site will grow, from what is known; (m,).

    share: of the largest a site can be, -E[l''] of one answer.  before: the last stage's power.
    """
    slow = np.minimum(SLOW_GROWTH / -np.log(np.clip(share, 1e-300, 0.9)), FASTEST_GROWTH)
    return np.where(before > SLOWEST_FAST, FASTEST_GROWTH, slow)


def stages(first: float, scale: float, ratio: float) -> list[float]:
    """The scales to solve at, from the first down to the one asked for."""
    count = max(0, ceil(log(first / scale) / log(ratio))) if scale < first else 0
    return [scale * (first / scale) ** (k / count) for k in range(count, 0, -1)] + [scale]


def largest_sites(answers: Answers) -> FloatArray:
    """-l'' never exceeds 1, so no optimal site exceeds this; (m,)."""
    return np.asarray(answers.counts / answers.scale**2)


def factor(features: FloatArray, sites: FloatArray) -> FloatArray | None:
    """Lower Cholesky factor of I + X' diag(sites) X, (r, r); None where rounding leaves none."""
    scaled = (features * np.sqrt(sites)[:, None]).T
    # Only the lower triangle is computed; the upper one stays that of the identity, which is none.
    identity = np.eye(len(scaled), order="F")
    precision = blas.dsyrk(1.0, scaled, beta=1.0, c=identity, lower=1, overwrite_c=1)
    root, info = lapack.dpotrf(precision, lower=1, clean=0, overwrite_a=1)
    return root if info == 0 else None


class Widths(NamedTuple):
    """q's covariance: the precision's lower root (r, r), and what follows from it of what the
    answers see, the spread (r, m) and the variance (m,); see `State`."""

    root: FloatArray
    spread: FloatArray
    variance: FloatArray


def widths(features: FloatArray, sites: FloatArray) -> Widths | None:
    """The covariance that these sites give, or None where rounding leaves none."""
    root = factor(features, sites)
    if root is None:
        return None
    spread, _ = lapack.dtrtrs(root, features.T, lower=1)
    return Widths(root, spread, np.einsum("ij,ij->j", spread, spread))


def evaluate(
    answers: Answers, mean: FloatArray, sites: FloatArray, known: Widths | None = None
) -> State | None:
    """The bound and its derivatives at (mean, sites); None where they are not finite.

    known: the covariance at these sites, where it is.
    """
    features, counts, scale = answers.features, answers.counts, answers.scale
    known = known or widths(features, sites)
    if known is None:
        return None
    root, spread, variance = known
    e = expectations(features @ mean / scale, np.sqrt(variance) / scale)
    divergence = 2.0 * np.log(root.diagonal()).sum() - sites @ variance + mean @ mean
    bound = float(counts @ e.value - 0.5 * divergence)
    if not isfinite(bound):
        return None
    weight = counts / scale
    slope = weight * e.slope
    return State(
        q=Gaussian(mean, root, sites, bound),
        spread=spread,
        variance=variance,
        gradient=slope @ features - mean,
        slope=slope,
        curvature=weight / scale * e.curvature,
        third=weight / scale**2 * e.third,
        fourth=weight / scale**3 * e.fourth,
    )


def move_mean(answers: Answers, mean: FloatArray, variance: FloatArray) -> FloatArray:
    """The best mean while what the answers see has this variance: Newton on a concave function."""
    features, scale = answers.features, answers.scale
    weight = answers.counts / scale
    width = np.sqrt(variance) / scale

    e = expectations(features @ mean / scale, width)
    value = float(answers.counts @ e.value - 0.5 * mean @ mean)
    for _ in range(MEAN_STEPS):
        gradient = (weight * e.slope) @ features - mean
        bend = factor(features, weight / scale * e.curvature)
        if bend is None:
            return mean
        step, _ = lapack.dpotrs(bend, gradient, lower=1)
        if float(step @ gradient) < MEAN_GAIN:
            # So near, a full step of Newton's method on a concave function needs no second look.
            return np.asarray(mean + step)
        for shortenings in range(8):
            tried = mean + step * 0.4**shortenings
            at = expectations(features @ tried / scale, width)
            reached = float(answers.counts @ at.value - 0.5 * tried @ tried)
            if reached >= value:
                mean, value, e = tried, reached, at
                break
        else:
            return mean
    return mean


def ascend(
    answers: Answers, state: State | None, floor: FloatArray, tolerance: float, *, strict: bool
) -> State:
    """Newton steps, each of which must raise the bound, until the residual is below tolerance."""
    if state is None:
        state = evaluate(answers, np.zeros(answers.features.shape[1]), floor)
    if state is None:
        raise FitError(f"fit: the bound is not finite at scale {answers.scale:g}")
    best = residual(state, floor)
    for _ in range(STEPS):
        if best < tolerance:
            return state
        moved = newton_step(answers, state, floor, best) or natural_step(answers, state)
        if moved is None:
            break
        state = moved
        best = residual(state, floor)
    if strict and not best < ACCEPTABLE:
        raise FitError(
            f"fit: expected a residual below {ACCEPTABLE:g} after {STEPS} steps, got {best:g} "
            f"({len(answers.counts)} different answers, scale {answers.scale:g})"
        )
    return state


def residual(state: State, floor: FloatArray) -> float:
    """Distance from the stationary point: of the mean in posterior deviations, of the sites in
    logarithms (those that matter: a site's weight is the share of variance it takes away)."""
    whitened, _ = lapack.dtrtrs(state.q.root, state.gradient, lower=1)
    error = np.log((state.curvature + floor) / (state.q.sites + floor))
    weight = np.minimum(1.0, 1e3 * state.q.sites * state.variance)
    return max(sqrt(float(whitened @ whitened)), float(np.abs(weight * error).max()))


def newton_step(answers: Answers, state: State, floor: FloatArray, error: float) -> State | None:
    """One joint Newton step on mean and log-sites, shortened until the bound rises."""
    features = answers.features
    held = state.q.sites + floor
    wanted = state.curvature + floor
    # With the covariance at hand in place of the one aimed for, steps go astray.
    root = factor(features, state.curvature)
    if root is None:
        return None
    ahead, _ = lapack.dtrtrs(root, features.T, lower=1)
    whitened, _ = lapack.dtrtrs(root, state.gradient, lower=1)

    # Eliminating the mean leaves one equation per site.
    right = np.log(wanted / held) - state.third / wanted * (whitened @ ahead)
    tolerance = min(SOLVED, error * SOLVED_SHARE)
    log_step, fall = solve_sites(state, ahead, held, wanted, right, tolerance)
    if not np.isfinite(log_step).all():
        return None
    pull = state.gradient - 0.5 * ((state.third * fall) @ features)
    mean_step, _ = lapack.dpotrs(root, pull, lower=1)

    # Each site by itself: one that goes far is often one that is to vanish, and of no consequence.
    log_step = np.clip(log_step, -LONGEST_STEP, LONGEST_STEP)
    length = 1.0
    cap = largest_sites(answers)
    for _ in range(6):
        sites = np.clip(held * np.exp(length * log_step) - floor, 0.0, cap)
        moved = evaluate(answers, state.q.mean + length * mean_step, sites)
        if moved is not None and moved.q.bound >= state.q.bound - ROUNDING * (
            1.0 + abs(state.q.bound)
        ):
            return moved
        length /= 3.0
    return None


def fall_of_variance(spread: FloatArray, change: FloatArray) -> FloatArray:
    """By how much the answers' variances fall when the sites rise by `change`; (m,)."""
    shared = (spread * change) @ spread.T  # (r, r)
    fall: FloatArray = np.einsum("ij,ij->j", spread, shared @ spread)
    return fall


def solve_sites(
    state: State,
    ahead: FloatArray,
    held: FloatArray,
    wanted: FloatArray,
    right: FloatArray,
    tolerance: float,
) -> tuple[FloatArray, FloatArray]:
    """The Newton step of the log-sites, and how the variances fall with it; (m,) each.

    By elimination where answers are few. Where they are many, iteratively, preconditioned by each
    site's own response if all sites moved together; and where they are very many, without forming
    anything of the size (m, m).
    """
    spread, fourth, third = state.spread, state.fourth, state.third
    count, variables = len(held), len(state.q.root)
    if count > VERY_MANY and count > VERY_MANY_PER_VARIABLE * variables:

        def falling(change: FloatArray) -> FloatArray:
            return fall_of_variance(spread, change)

    else:
        shared = spread.T @ spread
        squared = shared * shared  # fall of each variance per site, (m, m)

        def falling(change: FloatArray) -> FloatArray:
            return squared @ change

        if count <= FEW:
            system = third[:, None] * (ahead.T @ ahead) * third
            system.flat[:: count + 1] += fourth
            system = (-0.5 / wanted)[:, None] * (system @ squared) * held
            system.flat[:: count + 1] += 1.0
            _, _, step, info = lapack.dgesv(system, right)
            if info != 0:
                step = np.full(count, np.nan)
            return step, falling(held * step)

    response = 1.0 + np.maximum(-0.5 * fourth / wanted * falling(held), 0.0)

    def apply(step: FloatArray) -> FloatArray:
        fall = falling(held * step)
        carried = (ahead @ (third * fall)) @ ahead
        return np.asarray((step - 0.5 / wanted * (fourth * fall + third * carried)) / response)

    # Loaded here: no history of fewer than a hundred different answers comes this far.
    from scipy.sparse.linalg import LinearOperator, gmres  # noqa: PLC0415

    operator = LinearOperator((count, count), matvec=apply, dtype=np.float64)
    step, _ = gmres(operator, right / response, rtol=tolerance, restart=MOST_DIRECTIONS, maxiter=1)
    return step, falling(held * step)


def natural_step(answers: Answers, state: State) -> State | None:
    """A damped step along the natural gradient, which raises the bound wherever it can rise."""
    features = answers.features
    natural = state.q.root @ (state.q.root.T @ state.q.mean)
    seen = features @ state.q.mean
    target = (state.slope + state.curvature * seen) @ features
    damping = 0.5
    for _ in range(8):
        sites = (1.0 - damping) * state.q.sites + damping * state.curvature
        root = factor(features, sites)
        if root is not None:
            blend = (1.0 - damping) * natural + damping * target
            mean, _ = lapack.dpotrs(root, blend, lower=1)
            moved = evaluate(answers, mean, sites)
            if moved is not None and moved.q.bound > state.q.bound:
                return moved
        damping /= 4.0
    return None
