"""Points of a search space at which a trial's belief is drawn: a map, or a line per parameter."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pbbo import Box
from app.services.proposals.box_steps import Point, cached_box
from app.study.search_space import SearchSpace

#: Values of each of two parameters, between which a map has no visible step.
ACROSS: Final = 25
#: Values along a line.
ALONG: Final = 41


def points_to_draw(space: SearchSpace, through: Point) -> list[tuple[str | None, Point]]:
    """Points in the space's own units, each with the parameter that varies.

    For two parameters a grid over the space, where none is named. Otherwise lines through the point
    `through`, one along each parameter. Steps, logarithmic scales and constraints are kept to.
    """
    box = cached_box(space)
    if box.dimensions == 2:
        shares = np.linspace(0.0, 1.0, ACROSS)
        grid = np.array([(across, up) for across in shares for up in shares])
        return [(None, point) for point in _inside(box, grid)]
    here = box.kernel_coordinates(np.array([through]))[0]
    found: list[tuple[str | None, Point]] = []
    for place, name in enumerate(space.names):
        line = np.tile(here, (ALONG, 1))
        line[:, place] = np.linspace(0.0, 1.0, ALONG)
        found += [(name, point) for point in _inside(box, line)]
    return found


def _inside(box: Box, seen: NDArray[np.float64]) -> list[Point]:
    """The different points at these kernel coordinates (n, d) that lie in the space."""
    points = box.points(box.from_kernel_coordinates(seen))
    by_key = dict(zip(box.keys(points), points, strict=True))
    return [tuple(point.tolist()) for point in by_key.values() if box.contains(point[None])[0]]
