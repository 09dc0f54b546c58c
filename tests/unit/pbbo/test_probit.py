"""The expected log-likelihood and its derivatives against brute force quadrature."""

import numpy as np
import pytest
from scipy.special import log_ndtr

from app.pbbo.candidates import FloatArray
from app.pbbo.probit import derivatives, expectations

# From a loud evaluator to the paper's epsilon = 0.0001, and the seams between the two quadratures.
WIDTHS = [1e-3, 0.1, 0.126, 0.3, 0.999, 1.001, 3.0, 50.0, 7e3, 9e5]
OFFSETS = [-30.0, -8.001, -7.999, -3.0, 0.0, 0.7, 4.0, 7.9, 8.1, 20.0]


def brute_force(a: float, b: float) -> FloatArray:
    """E[log Phi] and E of its four derivatives over N(a, b^2), by eighty thousand nodes; (5,).

    The nodes lie densely about the likelihood's kink and about the Gaussian's own width.
    """
    low, high = a - 11.0 * b, a + 11.0 * b
    even = np.linspace(low, high, 40_001)
    kink = np.sinh(np.linspace(np.arcsinh(50.0 * low), np.arcsinh(50.0 * high), 40_001)) / 50.0
    x = np.unique(np.concatenate([even, kink]))
    density = np.exp(-0.5 * ((x - a) / b) ** 2) / (b * np.sqrt(2.0 * np.pi))
    return np.asarray(np.trapezoid(derivatives(x) * density, x, axis=1))


@pytest.mark.parametrize("width", WIDTHS)
def test_expectations_agree_with_brute_force_for_every_width(width: float) -> None:
    a = np.array(OFFSETS) * width

    e = expectations(a, np.full(len(a), width))

    expected = np.stack([brute_force(float(mean), width) for mean in a], axis=1)
    scale = np.maximum(np.abs(expected), 1e-3)
    assert np.abs(e.value - expected[0]) / scale[0] == pytest.approx(0.0, abs=3e-6)
    assert np.abs(e.slope - expected[1]) / scale[1] == pytest.approx(0.0, abs=3e-6)
    assert np.abs(-e.curvature - expected[2]) / scale[2] == pytest.approx(0.0, abs=3e-6)


def test_the_log_likelihood_is_the_library_s() -> None:
    x = np.linspace(-60.0, 10.0, 1401)

    assert derivatives(x)[0] == pytest.approx(log_ndtr(x), rel=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_each_derivative_is_the_finite_difference_of_the_one_before(order: int) -> None:
    x = np.linspace(-80.0, 6.0, 500)
    h = 1e-4

    above, below = derivatives(x + h), derivatives(x - h)

    difference = (above[order - 1] - below[order - 1]) / (2.0 * h)
    assert derivatives(x)[order] == pytest.approx(difference, rel=1e-5, abs=1e-6)


def test_derivatives_join_smoothly_where_the_series_takes_over() -> None:
    above, below = derivatives(np.array([-14.999999])), derivatives(np.array([-15.000001]))

    assert above[1:] == pytest.approx(below[1:], rel=1e-4)


@pytest.mark.parametrize("width", WIDTHS)
def test_slope_and_curvature_are_derivatives_of_the_expectation(width: float) -> None:
    a = np.array([-5.0, -1.0, 0.0, 0.5, 2.0, 4.0]) * width
    b = np.full(len(a), width)
    h = 1e-4 * width

    e, above, below = expectations(a, b), expectations(a + h, b), expectations(a - h, b)

    assert e.slope == pytest.approx((above.value - below.value) / (2.0 * h), rel=1e-4, abs=1e-8)
    assert -e.curvature == pytest.approx(
        (above.slope - below.slope) / (2.0 * h), rel=1e-4, abs=1e-8
    )


@pytest.mark.parametrize("width", WIDTHS)
def test_widening_costs_half_the_curvature(width: float) -> None:
    a = np.array([-5.0, -1.0, 0.0, 0.5, 2.0, 4.0]) * width
    variance = np.full(len(a), width**2)
    h = 1e-4 * width**2

    above, below = expectations(a, np.sqrt(variance + h)), expectations(a, np.sqrt(variance - h))

    slope = (above.value - below.value) / (2.0 * h)
    curvature = expectations(a, np.sqrt(variance)).curvature
    assert slope == pytest.approx(-0.5 * curvature, rel=1e-3, abs=1e-8)


def test_extreme_arguments_stay_finite_and_within_bounds() -> None:
    a = np.array([-1e7, -1e3, 0.0, 1e3, 1e7])
    for b in (1e-8, 1.0, 1e6):
        e = expectations(a, np.full(5, b))
        assert np.isfinite([e.value, e.slope, e.curvature, e.third, e.fourth]).all()
        assert (e.value <= 0.0).all()
        assert (e.slope >= 0.0).all()
        assert ((e.curvature >= 0.0) & (e.curvature <= 1.0)).all()
