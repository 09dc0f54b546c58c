"""A search space given by ranges: 1 to 8 parameters between bounds, which are inside.

Three coordinates are used. A point is in the parameters' own units; its share of the range runs
from 0 to 1 between the bounds, and constraints are linear in it; the kernel sees the share, or that
of the logarithm for a parameter on a logarithmic scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite, log
from typing import Any, Final

import numpy as np

from .candidates import FloatArray
from .errors import BoxError, ConstraintError, PointError
from .linear_constraints import HalfSpaces, half_spaces

#: More parameters than 30 answers can say anything about.
MOST_PARAMETERS: Final = 8
#: How far beyond a bound or a constraint rounding may put a point, as a share of the range.
SLACK: Final = 1e-9
#: The largest ball inside has to have this radius, as a share of the ranges.
LEAST_RADIUS: Final = 1e-6
#: A box in which every parameter has a step, and with no more points than this, is enumerated.
MOST_GRID_POINTS: Final = 4096
#: Points whose coordinates agree to so many digits, as shares of the ranges, are the same point.
DIGITS: Final = 9

#: What tells points apart.
Key = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Box:
    """low, high: the bounds of each of d parameters, which are inside.

    step: for each parameter the distance of its values, counted from low, or None for any value.
    log: for each parameter whether its scale is logarithmic.  names: by default x0, x1, ...
    constraints: texts such as "x0 >= x1", see `linear_constraints`.

    Raises `BoxError` or `ConstraintError` where there is no inside, or a part is wrong.
    """

    low: Sequence[float]
    high: Sequence[float]
    constraints: Sequence[str] = ()
    step: Sequence[float | None] | None = None
    log: Sequence[bool] | None = None
    names: Sequence[str] | None = None
    _spaces: HalfSpaces = field(init=False, repr=False)
    _grid: FloatArray | None = field(init=False, repr=False)
    _centre: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "low", numbers("low", self.low))
        put(self, "high", numbers("high", self.high))
        put(self, "names", checked_names(self.names, len(self.low)))
        for name in ("high", "step", "log"):
            given = getattr(self, name)
            if given is None:
                continue
            if not isinstance(given, (list, tuple, np.ndarray)) or len(given) != len(self.low):
                raise BoxError(
                    f"{name}: expected one for each of {len(self.low)} parameters, got {given!r}"
                )
        put(self, "step", (None,) * len(self.low) if self.step is None else tuple(self.step))
        put(self, "log", (False,) * len(self.low) if self.log is None else tuple(self.log))
        for place in range(self.dimensions):
            self._check_parameter(place)
        given = self.constraints
        if isinstance(given, str) or not isinstance(given, (list, tuple)):
            raise ConstraintError(f"constraints: expected a list of texts, got {given!r}")
        put(self, "constraints", tuple(given))
        spaces = half_spaces(self.constraints, self.parameter_names)
        span = self._high - self._low
        # In shares of the ranges: normal @ (low + span * share) <= offset.
        normal = spaces.normal * span
        offset = spaces.offset - spaces.normal @ self._low
        length = np.linalg.norm(normal, axis=1)
        put(self, "_spaces", HalfSpaces(normal / length[:, None], offset / length))
        put(self, "_centre", self._checked_centre())
        put(self, "_grid", self._enumerated())

    @property
    def dimensions(self) -> int:
        """How many parameters there are."""
        return len(self.low)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Their names."""
        assert self.names is not None
        return tuple(self.names)

    @property
    def grid(self) -> FloatArray | None:
        """All points (n, d), if every parameter has a step and they are few; otherwise None."""
        return self._grid

    @property
    def half_spaces(self) -> HalfSpaces:
        """The constraints in shares of the ranges, their normals of length 1."""
        return self._spaces

    @property
    def centre(self) -> FloatArray:
        """The middle of the largest ball inside, in shares of the ranges; (d,)."""
        return self._centre

    def shares(self, points: FloatArray) -> FloatArray:
        """Points as shares of the ranges; (n, d)."""
        return (points - self._low) / (self._high - self._low)

    def points(self, shares: FloatArray) -> FloatArray:
        """The points at these shares of the ranges, each on its step; (n, d)."""
        span = self._high - self._low
        out = self._low + np.clip(shares, 0.0, 1.0) * span
        for place, step in enumerate(self.step or ()):
            if step is not None:
                count = np.floor(span[place] / step + SLACK)
                whole = np.clip(np.round((out[:, place] - self._low[place]) / step), 0.0, count)
                out[:, place] = self._low[place] + whole * step
        return np.minimum(out, self._high)

    def kernel_coordinates(self, points: FloatArray) -> FloatArray:
        """What the kernel sees of points: shares, of logarithms where the scale is one; (n, d)."""
        out = self.shares(points)
        for place, logarithmic in enumerate(self.log or ()):
            if logarithmic:
                low, high = self._low[place], self._high[place]
                out[:, place] = np.log(points[:, place] / low) / log(high / low)
        return out

    def from_kernel_coordinates(self, seen: FloatArray) -> FloatArray:
        """Shares of the ranges of what the kernel sees; (n, d)."""
        out = np.clip(seen, 0.0, 1.0)
        for place, logarithmic in enumerate(self.log or ()):
            if logarithmic:
                low, high = self._low[place], self._high[place]
                out[:, place] = (low * (high / low) ** out[:, place] - low) / (high - low)
        return out

    def contains(self, points: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether each point satisfies bounds and constraints, to within rounding; (n,)."""
        shares = self.shares(points)
        inside = (shares >= -SLACK).all(axis=1) & (shares <= 1.0 + SLACK).all(axis=1)
        spaces = self._spaces
        return np.asarray(inside & (shares @ spaces.normal.T <= spaces.offset + SLACK).all(axis=1))

    def key(self, point: FloatArray) -> Key:
        """The same for points that are the same to within rounding."""
        return self.keys(point[None])[0]

    def keys(self, points: FloatArray) -> list[Key]:
        """The key of each point (n, d)."""
        # Adding 0.0 turns -0.0 into 0.0, which is the same share.
        rounded = np.round(self.shares(points), DIGITS) + 0.0
        return [tuple(row) for row in rounded.tolist()]

    def checked_point(self, point: Any) -> FloatArray:
        """A point of the box as an array (d,), or `PointError`."""
        try:
            array = np.array(point, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise PointError(f"point: expected {self.dimensions} numbers, got {point!r}") from error
        if array.shape != (self.dimensions,) or not np.isfinite(array).all():
            raise PointError(f"point: expected {self.dimensions} finite numbers, got {point!r}")
        if not self.contains(array[None])[0]:
            within = ", ".join(
                f"{name} from {low:g} to {high:g}"
                for name, low, high in zip(self.parameter_names, self.low, self.high, strict=True)
            )
            texts = "".join(f", {text}" for text in self.constraints)
            raise PointError(f"point: expected {within}{texts}; got {array.tolist()}")
        array.setflags(write=False)
        return array

    @property
    def _low(self) -> FloatArray:
        return np.array(self.low, dtype=np.float64)

    @property
    def _high(self) -> FloatArray:
        return np.array(self.high, dtype=np.float64)

    def _check_parameter(self, place: int) -> None:
        name, low, high = self.parameter_names[place], self.low[place], self.high[place]
        if not low < high:
            raise BoxError(f"{name}: expected low below high, got {low!r} and {high!r}")
        assert self.step is not None
        assert self.log is not None
        step, logarithmic = self.step[place], self.log[place]
        if not isinstance(logarithmic, (bool, np.bool_)):
            raise BoxError(f"{name}: expected log to be true or false, got {logarithmic!r}")
        if logarithmic and low <= 0.0:
            raise BoxError(f"{name}: expected low above 0 on a logarithmic scale, got {low!r}")
        if step is None:
            return
        number = isinstance(step, (int, float)) and not isinstance(step, bool)
        if not number or not isfinite(step) or step <= 0.0:
            raise BoxError(f"{name}: expected a step above 0 or none, got {step!r}")
        if step > (high - low) * (1.0 + SLACK):
            raise BoxError(
                f"{name}: expected a step of at most the range {high - low:g}, got {step!r}"
            )

    def _checked_centre(self) -> FloatArray:
        """The Chebyshev centre, by linear programming."""
        from scipy.optimize import linprog  # noqa: PLC0415, takes long to import

        d, spaces = self.dimensions, self._spaces
        bounds = np.vstack([np.eye(d), -np.eye(d)])
        normal = np.hstack(
            [np.vstack([spaces.normal, bounds]), np.ones((len(spaces.offset) + 2 * d, 1))]
        )
        offset = np.concatenate([spaces.offset, np.ones(d), np.zeros(d)])
        found = linprog(np.append(np.zeros(d), -1.0), A_ub=normal, b_ub=offset, bounds=(None, None))
        texts = ", ".join(self.constraints)
        at: FloatArray | None = found.x  # (d + 1,), the centre and the radius
        radius = -1.0 if at is None else float(at[-1])
        if radius < -SLACK:
            raise ConstraintError(
                f"constraints: expected a point within the bounds that satisfies all of {texts}; "
                "got none"
            )
        if at is None or radius < LEAST_RADIUS:
            raise ConstraintError(
                f"constraints: expected room for more than a line or a point; {texts} leave none"
            )
        return np.asarray(at[:d])

    def _enumerated(self) -> FloatArray | None:
        if any(step is None for step in self.step or ()):
            return None
        values = [
            low + step * np.arange(int(np.floor((high - low) / step + SLACK)) + 1)
            for low, high, step in zip(self.low, self.high, self.step or (), strict=True)
            if step is not None
        ]
        if np.prod([float(len(each)) for each in values]) > MOST_GRID_POINTS:
            return None
        points: FloatArray = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1)
        points = points.reshape(-1, self.dimensions)
        points = np.minimum(points, self._high)
        points = np.asarray(points[self.contains(points)])
        if len(points) < 2:
            raise ConstraintError(
                "constraints: expected at least two points on the steps that satisfy "
                f"{', '.join(self.constraints)}; got {len(points)}"
            )
        return points


def numbers(name: str, values: object) -> tuple[float, ...]:
    """1 to 8 finite numbers as a tuple, or `BoxError`."""
    if not isinstance(values, (list, tuple, np.ndarray)):
        raise BoxError(f"{name}: expected a list of numbers, got {values!r}")
    if not 1 <= len(values) <= MOST_PARAMETERS:
        raise BoxError(f"{name}: expected 1 to {MOST_PARAMETERS} numbers, got {len(values)}")
    for value in values:
        number = isinstance(value, (int, float, np.integer, np.floating))
        if not number or isinstance(value, bool) or not isfinite(value):
            raise BoxError(f"{name}: expected finite numbers, got {value!r}")
    return tuple(float(value) for value in values)


def checked_names(names: object, count: int) -> tuple[str, ...]:
    """Different names, one for each parameter, or `BoxError`."""
    if names is None:
        return tuple(f"x{place}" for place in range(count))
    if not isinstance(names, (list, tuple)) or len(names) != count:
        raise BoxError(f"names: expected one for each of {count} parameters, got {names!r}")
    for name in names:
        if not isinstance(name, str) or not name.isidentifier():
            raise BoxError(
                f"names: expected letters, digits and underscores, a letter first, got {name!r}"
            )
    if len(set(names)) != count:
        raise BoxError(f"names: expected different names, got {', '.join(names)}")
    return tuple(names)
