"""The probit likelihood of one answer, and its expectation under a Gaussian.

With x = (f_winner - f_loser) / (sqrt(2) epsilon), an answer has probability Phi(x). (Eq. 7 of the
paper as printed is the probability of the opposite answer; Eq. 6 fixes which is meant.)

The variational posterior needs E[log Phi(x)], x ~ N(a, b^2), and its derivatives in a, for b from
far below 1 (a loud evaluator) to 10^4 and more (the paper's epsilon = 0.0001), where log Phi looks
like a parabola cut off at a kink and no fixed Gauss-Hermite rule is right. So for wide Gaussians
the parabola is taken out in closed form: with

    c(x) = ((x^2 + 1) Phi(-x) - x phi(x)) / 2        (a smoothed x^2 / 2 for x < 0),

E[c] is the same expression with a and sqrt(1 + b^2), and the rest, log Phi + c, is analytic and
grows like log|x|, so that a trapezoidal sum over x = sinh(u) integrates it to about 1e-8. The
nodes are fixed, hence so are the values of the rest: an expectation costs one exponential per node.
Narrow Gaussians, and those whose mass lies clear of the kink on its left, use Gauss-Hermite
quadrature.
"""

from functools import cache
from math import prod
from typing import Final, NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr

from .candidates import FloatArray

SQRT_2PI: Final = float(np.sqrt(2.0 * np.pi))

# Below this, log Phi is evaluated by its asymptotic series: the direct form loses its digits.
SERIES_BELOW: Final = -15.0
# phi(t) / Phi(-t) - t = 1/t - 2/t^3 + 10/t^5 - ...; the last term is 5e-12 of the first at t = 15.
EXCESS_SERIES: Final = (1.0, -2.0, 10.0, -74.0, 706.0, -8162.0, 110410.0, -1708394.0, 29752066.0)
# Beyond this many standard deviations a Gaussian's mass is below 1e-15.
REACH: Final = 8.0
# Step of the trapezoidal sum in u. A Gaussian at least that wide in u = asinh(x) leaves an error of
# exp(-2 pi^2), 3e-9.
STEP: Final = 1.0 / REACH
# x from -2e8 (twice REACH standard deviations of 1e6 and more) to 9, where log Phi vanishes.
LOWEST_NODE: Final = -20.0
HIGHEST_NODE: Final = 3.0
# Gauss-Hermite on the others, which are narrow beside what log Phi does where they lie.
HERMITE_POINTS: Final = 20


class Expectations(NamedTuple):
    """E[log Phi] and what its derivatives are made of; each (m,).

    value: E[l];  slope: E[l'], positive;  curvature: -E[l''], within [0, 1];
    third: E[l'''];  fourth: E[l''''].
    """

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray
    third: FloatArray
    fourth: FloatArray


def derivatives(x: FloatArray) -> FloatArray:
    """log Phi and its first four derivatives at x; shape (5, *x.shape)."""
    out = np.empty((5, *x.shape))
    far = x < SERIES_BELOW
    safe = np.where(far, 0.0, x)
    log_cdf = log_ndtr(safe)
    hazard = np.exp(-0.5 * safe * safe - log_cdf) / SQRT_2PI
    excess = hazard + safe
    second = -hazard * excess
    steep = excess * (hazard + excess) - 1.0
    out[0] = log_cdf
    out[1] = hazard
    out[2] = second
    out[3] = hazard * steep
    out[4] = second * steep + hazard * (
        (second + 1.0) * (hazard + excess) + excess * (2.0 * second + 1.0)
    )
    if far.any():
        t = -x[far]
        out[0, far] = -0.5 * t * t + log_excess(t)
        out[1, far] = t + excess_series(t, 0)
        out[2, far] = -1.0 - excess_series(t, 1)
        out[3, far] = excess_series(t, 2)
        out[4, far] = -excess_series(t, 3)
    return out


def excess_series(t: FloatArray, order: int) -> FloatArray:
    """The derivative of this order, in t, of phi(t) / Phi(-t) - t, for large t."""
    total = np.zeros_like(t)
    for k, coefficient in enumerate(EXCESS_SERIES):
        power = 2 * k + 1
        factor = prod(-(power + i) for i in range(order))
        total += coefficient * factor * t ** -(power + order)
    return total


def log_excess(t: FloatArray) -> FloatArray:
    """log Phi(-t) + t^2 / 2 for large t."""
    q = 1.0 / (t * t)
    mills = q * (-1.0 + q * (3.0 + q * (-15.0 + q * (105.0 + q * (-945.0 + q * 10395.0)))))
    return np.asarray(np.log1p(mills) - np.log(SQRT_2PI * t))


def parabola(a: FloatArray, spread: FloatArray) -> FloatArray:
    """-E[c(x)] and its first four derivatives in a, for x ~ N(a, spread^2 - 1); (5, m)."""
    out = np.empty((5, len(a)))
    t = a / spread
    below = ndtr(-t)
    density = np.exp(-0.5 * t * t)
    density /= SQRT_2PI
    np.multiply(spread, density, out=out[1])
    out[1] -= a * below
    np.negative(below, out=out[2])
    np.divide(density, spread, out=out[3])
    np.multiply(out[3], t / -spread, out=out[4])
    # E[c] = (spread^2 E[c''] + a E[c']) / 2.
    out[0] = -0.5 * (spread * spread * below - a * out[1])
    return out


@cache
def table() -> tuple[FloatArray, FloatArray]:
    """Nodes x (k,) and the weighted rest, log Phi + c and its derivatives, at them (5, k)."""
    u = np.arange(LOWEST_NODE, HIGHEST_NODE + STEP / 2.0, STEP)
    x = np.sinh(u)
    rest = derivatives(x) - parabola(x, np.ones_like(x))
    far = x < SERIES_BELOW
    # The difference of two large numbers, again by its series; there c = (x^2 + 1) / 2.
    t = -x[far]
    rest[0, far] = 0.5 + log_excess(t)
    for order in range(4):
        rest[1 + order, far] = (-1.0) ** order * excess_series(t, order)
    return x, rest * (STEP * np.cosh(u) / SQRT_2PI)


@cache
def hermite() -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of E over a standard normal."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(HERMITE_POINTS)
    return nodes, weights / weights.sum()


def expectations(a: FloatArray, b: FloatArray) -> Expectations:
    """Expectations of log Phi and its derivatives over N(a, b^2); a, b: (m,), b > 0."""
    # At least a STEP wide in u; or clear of the kink on its right, where the closed form is all.
    # Not written as its complement, so that a NaN goes to a branch that lets it through.
    wide = ((REACH * b) ** 2 > 1.0 + a * a) | ((b > 1.0) & (a > 0.0))
    if wide.all():
        out = wide_expectations(a, b)
    else:
        out = np.empty((5, len(a)))
        if wide.any():
            out[:, wide] = wide_expectations(a[wide], b[wide])
        narrow = ~wide
        nodes, weights = hermite()
        out[:, narrow] = derivatives(a[narrow, None] + b[narrow, None] * nodes) @ weights
    np.maximum(out[1], 0.0, out=out[1])
    curvature = np.minimum(np.maximum(-out[2], 0.0), 1.0)
    return Expectations(out[0], out[1], curvature, out[3], out[4])


def wide_expectations(a: FloatArray, b: FloatArray) -> FloatArray:
    """The five expectations by the closed form and the table; (5, m)."""
    nodes, rest = table()
    start = int(np.searchsorted(nodes, float((a - REACH * b).min())))
    inverse = 1.0 / b
    # In place: this array, (m, k), is what a fit spends most of its memory traffic on.
    density = nodes[start:] - a[:, None]
    density *= inverse[:, None]
    density *= density
    density *= -0.5
    np.exp(density, out=density)
    out = rest[:, start:] @ density.T
    out *= inverse
    out += parabola(a, np.sqrt(1.0 + b * b))
    return np.asarray(out)
