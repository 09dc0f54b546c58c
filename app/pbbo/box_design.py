"""Points of a box to look at: quasi-random ones, some on its boundary, and ones around good ones.

The acquisition of a finite set of candidates looks at all of them. In a box it looks at a design:
scrambled Sobol points over the whole, some of them moved to the boundary (an optimum often lies
there, and no random point does), everything shown so far, and points around what is good by now.
"""

from typing import Final

import numpy as np

from .box import Box
from .candidates import FloatArray
from .errors import ConstraintError

#: Points over the whole box for each parameter, and how many at most.
POINTS_PER_PARAMETER: Final = 128
MOST_POINTS: Final = 768
#: Points for first queries; a first phase is shorter.
FIRST_POINTS: Final = 64
#: Every so many points one is moved to the boundary.
BOUNDARY_EVERY: Final = 4
#: Sobol points tried before the region is walked through instead.
MOST_TRIED: Final = 2**15
#: Constraints that leave less of the box than this cut off most of it.
ENOUGH_INSIDE: Final = 0.25
#: Steps of a walk between two points that are kept.
WALK_STEPS: Final = 8
#: Standard deviations of points around a good one, as shares of the ranges, for two parameters.
CLOSE: Final = (0.03, 0.1)
#: Points around each good one at each of these distances.
AROUND: Final = 12
#: Rounds of projection onto the constraints in turn.
PROJECTIONS: Final = 20


def whole(box: Box, rng: np.random.Generator) -> FloatArray:
    """Points over the whole box, in its units; (n, d). All of a small grid."""
    if box.grid is not None:
        return box.grid
    count = min(POINTS_PER_PARAMETER * box.dimensions, MOST_POINTS)
    shares = spread(box, rng, count)
    moved = np.arange(0, len(shares), BOUNDARY_EVERY)
    shares[moved] = to_boundary(box, shares[moved], rng)
    return distinct(box, box.points(shares))


def first_points(box: Box, rng: np.random.Generator) -> FloatArray:
    """Different points for the first queries, spread over the box, in its units; (n, d)."""
    return distinct(box, box.points(spread(box, rng, FIRST_POINTS)))


def spread(box: Box, rng: np.random.Generator, count: int) -> FloatArray:
    """Scrambled Sobol points, as shares of the ranges; (count, d).

    Points that violate a constraint are moved onto it, as a list of candidates would take the
    nearest, so that a constraint is covered as densely as what it cuts off. Where it cuts off most
    of the box, only points inside are taken.
    """
    from scipy.stats import qmc  # noqa: PLC0415, takes long to import

    sampler = qmc.Sobol(box.dimensions, scramble=True, rng=rng)
    batch = 2 ** int(np.ceil(np.log2(max(count, 16))))
    shares = box.from_kernel_coordinates(sampler.random(batch))
    inside = box.contains(box.points(shares))
    if inside.mean() >= ENOUGH_INSIDE:
        shares = projected(box, shares)
        return shares[box.contains(box.points(shares))][:count]
    found = [shares[inside]]
    tried, have = batch, int(inside.sum())
    while have < count and tried < MOST_TRIED:
        shares = box.from_kernel_coordinates(sampler.random(batch))
        inside = box.contains(box.points(shares))
        found.append(shares[inside])
        have += int(inside.sum())
        tried += batch
    if have < count:
        found.append(walk(box, rng, count - have))
    return np.vstack(found)[:count]


def walk(box: Box, rng: np.random.Generator, count: int) -> FloatArray:
    """Points inside a region too slim to hit, by hit and run from its centre, as shares; (n, d)."""
    here = box.centre
    kept = []
    for _ in range(count):
        for _ in range(WALK_STEPS):
            direction = rng.standard_normal(box.dimensions)
            direction /= np.linalg.norm(direction)
            ahead = reach(box, here[None], direction[None])[0]
            behind = reach(box, here[None], -direction[None])[0]
            here = here + direction * rng.uniform(-behind, ahead)
        kept.append(here)
    shares = np.array(kept)
    inside = box.contains(box.points(shares))
    if inside.sum() < 2:
        raise ConstraintError(
            "constraints: expected at least two points on the steps that satisfy "
            f"{', '.join(box.constraints)}; found {int(inside.sum())}"
        )
    return shares[inside]


def reach(box: Box, shares: FloatArray, directions: FloatArray) -> FloatArray:
    """How far each point can go in its direction until it meets a bound or constraint; (n,)."""
    normal = np.vstack([box.half_spaces.normal, np.eye(box.dimensions), -np.eye(box.dimensions)])
    offset = np.concatenate(
        [box.half_spaces.offset, np.ones(box.dimensions), np.zeros(box.dimensions)]
    )
    speed = directions @ normal.T
    room = np.maximum(offset - shares @ normal.T, 0.0)
    return np.asarray(np.where(speed > 1e-12, room / np.maximum(speed, 1e-12), np.inf).min(axis=1))


def to_boundary(box: Box, shares: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points moved in a random direction until they meet the boundary, as shares; (n, d)."""
    directions = rng.standard_normal(shares.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(shares + directions * reach(box, shares, directions)[:, None])


def around(box: Box, points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points near these (k, d), inside, in the box's units; (n, d)."""
    seen = box.kernel_coordinates(points)
    stretch = float(np.sqrt(box.dimensions / 2.0))
    near = [
        np.repeat(seen, AROUND, axis=0)
        + close * stretch * rng.standard_normal((AROUND * len(seen), box.dimensions))
        for close in CLOSE
    ]
    shares = projected(box, box.from_kernel_coordinates(np.vstack(near)))
    found = box.points(shares)
    return found[box.contains(found)]


def projected(box: Box, shares: FloatArray) -> FloatArray:
    """Points moved onto bounds and constraints that they violate, in turn; not always inside."""
    out = np.clip(shares, 0.0, 1.0)
    normal, offset = box.half_spaces
    if not len(offset):
        return out
    for _ in range(PROJECTIONS):
        for one, limit in zip(normal, offset, strict=True):
            beyond = np.maximum(out @ one - limit, 0.0)
            out = out - beyond[:, None] * one
        out = np.clip(out, 0.0, 1.0)
        if (out @ normal.T <= offset).all():
            break
    return out


def distinct(box: Box, points: FloatArray) -> FloatArray:
    """The points inside, each once, in order; (n, d)."""
    points = points[box.contains(points)]
    first = {key: place for place, key in reversed(list(enumerate(box.keys(points))))}
    return points[sorted(first.values())]
