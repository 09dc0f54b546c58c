"""Steps over a search space given by ranges: the next pair of points, and the acquired point.

A step is a pure function of the space, the settings, the trial's seed and what it is computed from:
the answered queries, the pairs that wait for a response, and the points that are not proposed.
Points are tuples of numbers in the parameters' own units.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

import numpy as np

from app.pbbo import Box, BoxOptimizer, FitError, PointError, Settings
from app.services.runtime.errors import NothingToShowError
from app.study.search_space import SearchSpace

from .boxes import box_in

Point = tuple[float, ...]

#: One answered query: left, right, "left" | "right" | "skip", and the reason of a skip if any.
PointAnswer = tuple[Point, Point, str] | tuple[Point, Point, str, str | None]


@dataclass(frozen=True)
class BoxRequest:
    """The input of one step over a space.

    new: how many points of the pair may be new. history: the answered queries that are learnt from,
    oldest first. pending: pairs that wait for a response. excluded: points that are unsafe, which
    is learnt from. unavailable: points that could not be recorded. proposes: whether the next pair
    is computed. acquires: whether the acquired point is computed. within: what to be sure of, as
    for `BoxOptimizer.sureness`; None to leave that out.
    """

    space: SearchSpace
    settings: Mapping[str, Any] = field(compare=False)
    seed: int
    new: int
    history: tuple[PointAnswer, ...]
    pending: tuple[tuple[Point, Point], ...] = ()
    excluded: tuple[Point, ...] = ()
    unavailable: tuple[Point, ...] = ()
    proposes: bool = True
    acquires: bool = True
    within: float | None = None


@dataclass(frozen=True)
class ProposedPair:
    """Two points to compare. likelier: the side that the model expects to win."""

    left: Point
    right: Point
    trial_type: str
    acquisition: str
    likelier: str


@dataclass(frozen=True)
class AcquiredPoint:
    """The maximum of the posterior mean over the space, with mean and deviation there.

    mean, std: None if the model could not be fitted. sureness: the probability that no point is
    better by more than the request's `within`; None in that case too, or if not asked for.
    """

    point: Point
    mean: float | None
    std: float | None
    sureness: float | None = None


@dataclass(frozen=True)
class BoxStep:
    """The output of one step. acquired: None after an empty history."""

    pair: ProposedPair | None
    acquired: AcquiredPoint | None


def compute_box_step(request: BoxRequest) -> BoxStep:
    """Compute one step. Pure. Raises NothingToShowError if fewer than two points are left."""
    try:
        optimizer = optimizer_of(request)
    except PointError as error:
        raise NothingToShowError(str(error)) from error
    return BoxStep(
        pair=_pair(optimizer) if request.proposes else None,
        acquired=_acquired(optimizer, request.within)
        if request.acquires and request.history
        else None,
    )


@cache
def load() -> None:
    """Load what a first proposal needs, by making one: a second or more, the first time.

    Called outside transactions: a first proposal is computed within one, and all who write would
    wait for it.
    """
    BoxOptimizer(Box([0, 0], [1, 1], constraints=["x0 >= x1"])).ask()


def optimizer_of(request: BoxRequest) -> BoxOptimizer:
    """The optimiser after the request's history."""
    return BoxOptimizer.replay(
        cached_box(request.space),
        request.history,
        seed=request.seed,
        settings=Settings.from_mapping(request.settings),
        new=request.new,
        excluded=request.excluded,
        unavailable=request.unavailable,
        pending=request.pending,
    )


@lru_cache(maxsize=64)
def cached_box(space: SearchSpace) -> Box:
    """The box of a search space: its construction solves a linear program."""
    return box_in(space)


@lru_cache(maxsize=65536)
def point_key(space: SearchSpace, point: Point) -> str:
    """What tells points of a space apart, as stored in `candidates.point_key`."""
    return ",".join(map(repr, cached_box(space).key(np.array(point, dtype=np.float64))))


def posterior_at(
    request: BoxRequest, points: Iterable[Point]
) -> tuple[list[float], list[float]] | None:
    """Posterior mean and deviation at these points; None if the model could not be fitted."""
    try:
        mean, std = optimizer_of(request).posterior(list(points))
    except FitError:
        return None
    return mean.tolist(), std.tolist()


def _pair(optimizer: BoxOptimizer) -> ProposedPair:
    query = optimizer.ask()
    likelier = "left"
    if query.trial_type == "model":
        try:
            mean, _ = optimizer.posterior([query.left, query.right])
            likelier = "left" if mean[0] >= mean[1] else "right"
        except FitError:
            pass
    return ProposedPair(
        left=tuple(query.left.tolist()),
        right=tuple(query.right.tolist()),
        trial_type=query.trial_type,
        acquisition=query.acquisition,
        likelier=likelier,
    )


def _acquired(optimizer: BoxOptimizer, within: float | None) -> AcquiredPoint:
    best = optimizer.best()
    point: Point = tuple(best.tolist())
    try:
        mean, std = optimizer.posterior([best])
    except FitError:
        return AcquiredPoint(point, None, None)
    sureness = None if within is None else optimizer.sureness(within)
    return AcquiredPoint(point, float(mean[0]), float(std[0]), sureness)
