"""The box: its bounds, steps, scales and constraints, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest

from app.pbbo import Box, BoxError, ConstraintError, PointError
from app.pbbo.box_design import first_points, whole


def test_bounds_are_inside() -> None:
    box = Box(low=[0, -1], high=[2, 3])

    corners = np.array([[0.0, -1.0], [2.0, 3.0], [0.0, 3.0]])
    assert box.contains(corners).all()
    assert not box.contains(np.array([[2.0 + 1e-6, 0.0], [1.0, -1.1]])).any()


def test_constraints_are_chains_of_linear_expressions() -> None:
    box = Box(
        low=[0, 0],
        high=[1, 1],
        names=["w0", "w1"],
        constraints=["0.2 <= w1 <= w0", "w0*2 - w1/4 <= 1.5"],
    )

    inside = box.contains(np.array([[0.5, 0.4], [0.4, 0.5], [0.5, 0.1], [0.95, 0.2]]))
    assert inside.tolist() == [True, False, False, False]


def test_points_are_put_on_their_steps_within_the_bounds() -> None:
    box = Box(low=[0.05, 0], high=[1, 1], step=[0.3, None])

    points = box.points(np.array([[0.0, 0.3], [0.5, 0.5], [1.0, 1.0]]))

    assert points[:, 0] == pytest.approx([0.05, 0.65, 0.95])
    assert points[:, 1] == pytest.approx([0.3, 0.5, 1.0])


def test_a_box_of_few_steps_is_all_of_its_points() -> None:
    box = Box(low=[0, 0], high=[1, 1], step=[0.05, 0.05], constraints=["x0 >= x1"])

    assert box.grid is not None
    assert len(box.grid) == 231
    np.testing.assert_array_equal(whole(box, np.random.default_rng(0)), box.grid)


def test_the_kernel_sees_the_logarithm_of_a_logarithmic_parameter() -> None:
    box = Box(low=[0.001, 0], high=[10, 1], log=[True, False])
    points = np.array([[0.001, 0.0], [0.1, 0.5], [10.0, 1.0]])

    seen = box.kernel_coordinates(points)

    assert seen[:, 0] == pytest.approx([0.0, 0.5, 1.0])
    assert box.points(box.from_kernel_coordinates(seen)) == pytest.approx(points)


@pytest.mark.parametrize("d", [1, 2, 3, 8])
def test_the_design_lies_inside_and_reaches_the_boundary(d: int) -> None:
    constraints = ["x0 >= x1"] if d > 1 else []
    box = Box(low=[0.0] * d, high=[1.0] * d, constraints=constraints)

    points = whole(box, np.random.default_rng(1))

    assert box.contains(points).all()
    assert len({box.key(point) for point in points}) == len(points)
    on_bound = ((points < 1e-9) | (points > 1.0 - 1e-9)).any(axis=1)
    assert on_bound.sum() == 2 if d == 1 else on_bound.mean() > 0.1
    assert box.contains(first_points(box, np.random.default_rng(2))).all()


def test_a_constraint_is_covered_as_densely_as_what_it_cuts_off() -> None:
    box = Box(low=[0, 0], high=[1, 1], constraints=["x0 >= x1"])

    points = first_points(box, np.random.default_rng(1))

    on_diagonal = np.abs(points[:, 0] - points[:, 1]) < 1e-9
    assert 0.3 < on_diagonal.mean() < 0.7
    along = np.sort(points[on_diagonal, 0])
    assert np.diff(along).max() < 0.2


def test_a_slim_region_is_walked_through() -> None:
    box = Box(low=[0] * 4, high=[1] * 4, constraints=["x0 + x1 + x2 + x3 <= 0.02"])

    points = whole(box, np.random.default_rng(1))

    assert len(points) > 100
    assert box.contains(points).all()
    assert points.sum(axis=1).std() > 1e-3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"low": [], "high": []}, r"low: expected 1 to 8 numbers, got 0"),
        ({"low": [0] * 9, "high": [1] * 9}, r"low: expected 1 to 8 numbers, got 9"),
        (
            {"low": [0, 0], "high": [1]},
            r"high: expected one for each of 2 parameters, got \(1.0,\)",
        ),
        ({"low": [0], "high": [math.inf]}, r"high: expected finite numbers, got inf"),
        ({"low": [0], "high": ["1"]}, r"high: expected finite numbers, got '1'"),
        ({"low": 0, "high": [1]}, r"low: expected a list of numbers, got 0"),
        ({"low": [1, 0], "high": [1, 1]}, r"x0: expected low below high, got 1.0 and 1.0"),
        ({"low": [2, 0], "high": [1, 1]}, r"x0: expected low below high, got 2.0 and 1.0"),
        ({"step": [2.0, None]}, r"x0: expected a step of at most the range 1, got 2.0"),
        ({"step": [0.0, None]}, r"x0: expected a step above 0 or none, got 0.0"),
        ({"step": [True, None]}, r"x0: expected a step above 0 or none, got True"),
        ({"step": [0.1]}, r"step: expected one for each of 2 parameters, got \[0.1\]"),
        ({"log": [True, False]}, r"x0: expected low above 0 on a logarithmic scale, got 0.0"),
        ({"low": [-1, 0], "log": [True, False]}, r"x0: expected low above 0 on a log.*got -1.0"),
        ({"log": ["yes", False]}, r"x0: expected log to be true or false, got 'yes'"),
        ({"names": ["a"]}, r"names: expected one for each of 2 parameters, got \['a'\]"),
        ({"names": ["a", "a"]}, r"names: expected different names, got a, a"),
        ({"names": ["a", "b c"]}, r"names: expected letters, digits and underscores.*got 'b c'"),
    ],
)
def test_a_box_that_cannot_be_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(BoxError, match=message):
        Box(**{"low": [0, 0], "high": [1, 1], **given})


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        (["x0 + x1 >= 3"], r"expected a point within the bounds .* x0 \+ x1 >= 3; got none"),
        (["x0 >= 0.6", "x0 <= 0.4"], r"satisfies all of x0 >= 0.6, x0 <= 0.4; got none"),
        (["x0 >= 1"], r"expected room for more than a line or a point; x0 >= 1 leave none"),
        (["x0 + x1 >= 2"], r"expected room for more than a line or a point"),
        (["x0 >= w1"], r"'x0 >= w1': expected parameters from x0, x1, got 'w1'"),
        (["x0 * x1 <= 1"], r"expected linear expressions of x0, x1, got 'x0 \* x1'"),
        (["x0 / 0 <= 1"], r"expected linear expressions of x0, x1, got 'x0 / 0'"),
        (["x0 ** 2 <= 1"], r"expected linear expressions"),
        (["abs(x0) <= 1"], r"expected linear expressions of x0, x1, got 'abs\(x0\)'"),
        (["__import__('os').system('true') <= x0"], r"expected linear expressions"),
        (["x0 < x1"], r"'x0 < x1': expected <= or >=, got another sign"),
        (["x0 == x1"], r"expected <= or >=, got another sign"),
        (["x0 + x1"], r"'x0 \+ x1': expected <= or >= between two expressions"),
        (["x0 >= "], r"'x0 >= ': expected an inequality such as"),
        (["1 <= 2"], r"'1 <= 2': expected a parameter that it bounds, got none"),
        (["x0 <= 1e999"], r"expected finite numbers"),
        (["(" * 300 + "x0" + ")" * 300 + "<= x1"], r"at most 500 characters, got 607"),
        ([3], r"expected a text such as 'x0 >= x1', got 3"),
        ("x0 >= x1", r"constraints: expected a list of texts, got 'x0 >= x1'"),
    ],
)
def test_a_constraint_that_cannot_be_is_refused(constraints: Any, message: str) -> None:
    with pytest.raises(ConstraintError, match=message):
        Box(low=[0, 0], high=[1, 1], constraints=constraints)


def test_constraints_that_leave_no_point_on_the_steps_are_refused() -> None:
    with pytest.raises(ConstraintError, match=r"at least two points on the steps .*; got 0"):
        Box(low=[0, 0], high=[1, 1], step=[0.5, 0.5], constraints=["0.6 <= x0 <= 0.9"])


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([0.1, 0.5], r"expected x0 from 0 to 1, x1 from 0 to 1, x0 >= x1; got \[0.1, 0.5\]"),
        ([0.1], r"expected 2 finite numbers, got \[0.1\]"),
        ([0.1, math.nan], r"expected 2 finite numbers"),
        ("here", r"expected 2 numbers, got 'here'"),
    ],
)
def test_a_point_outside_is_refused(point: Any, message: str) -> None:
    box = Box(low=[0, 0], high=[1, 1], constraints=["x0 >= x1"])

    with pytest.raises(PointError, match=message):
        box.checked_point(point)
