"""The two environments of the crane world, their constants, and the search space (Sec. V-C).

Every constant is a property of the machine or of the waste; none depends on the candidate. Weights
are grams, times are seconds, and an opening runs from 0 (closed) to 1 (fully open). The constants
marked "fitted" were found by the random search of ``app.crane.calibration``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

TIME_STEP_S = 0.05  # step of w0 and w1: 21 points from 0 to 1 s (Sec. V-C)
TIME_POINTS = 21
LIBRARY_SEED = 20240731  # fixes every recorded run; another value records another library


class EnvironmentConstantError(ValueError):
    """A physical constant lies outside what can exist."""


class UnknownEnvironmentError(KeyError):
    """No environment has this name."""


def _require(owner: object, *, at_least_zero: tuple[str, ...], above_zero: tuple[str, ...]) -> None:
    for name in (*at_least_zero, *above_zero):
        value = float(getattr(owner, name))
        good = math.isfinite(value) and (value > 0 or (value == 0 and name in at_least_zero))
        if not good:
            wanted = "a finite number, at least 0" if name in at_least_zero else "a number above 0"
            raise EnvironmentConstantError(
                f"{type(owner).__name__}.{name}: expected {wanted}, got {value!r}"
            )


@dataclass(frozen=True)
class Claws:
    """The servo that moves the claws."""

    opening_speed: float  # openings per second
    closing_speed: float  # openings per second
    dead_time: float  # s, the claws stand still this long after each reversal

    def __post_init__(self) -> None:
        _require(
            self,
            at_least_zero=("dead_time",),
            above_zero=("opening_speed", "closing_speed"),
        )


@dataclass(frozen=True)
class Grasp:
    """What the bucket holds when a run begins."""

    weight: float  # g, mean over runs
    spread: float  # standard deviation over runs, as a fraction of the mean

    def __post_init__(self) -> None:
        _require(self, at_least_zero=("spread",), above_zero=("weight",))


@dataclass(frozen=True)
class ClumpEnvironment:
    """Shredded paper and packing: pieces that hang together and fall in clumps."""

    name: str
    claws: Claws
    grasp: Grasp
    pieces: int  # pieces in one grasp
    piece_shape: float  # shape of the gamma law of piece weights: large is even, small uneven
    threshold_mean: float  # opening at which a piece can begin to fall, mean over pieces
    threshold_spread: float  # its standard deviation over pieces
    fall_rate: float  # falls per second and piece, at an opening 1 beyond the piece's threshold
    jolt: float  # expected falls per piece and jolt, at an opening 1 beyond its threshold
    looseness_spread: float  # log standard deviation over runs of how loosely the waste is held
    entanglement: float  # chance that a piece drags its neighbour along

    def __post_init__(self) -> None:
        _require(
            self,
            at_least_zero=(
                "threshold_mean",
                "threshold_spread",
                "jolt",
                "looseness_spread",
                "entanglement",
            ),
            above_zero=("pieces", "piece_shape", "fall_rate"),
        )
        if self.entanglement > 1:
            raise EnvironmentConstantError(
                f"ClumpEnvironment.entanglement: expected a chance up to 1, "
                f"got {self.entanglement!r}"
            )


@dataclass(frozen=True)
class GrainEnvironment:
    """Chopped straw: grains that run out of an orifice (Beverloo's law)."""

    name: str
    claws: Claws
    grasp: Grasp
    flow: float  # g/s through a gap of one opening beyond the dead gap
    flow_spread: float  # log standard deviation of the flow over runs
    dead_gap: float  # opening up to which the grains bridge the gap and nothing runs

    def __post_init__(self) -> None:
        _require(self, at_least_zero=("flow_spread", "dead_gap"), above_zero=("flow",))


Environment: TypeAlias = ClumpEnvironment | GrainEnvironment

# Fitted: `python -m app.crane.calibration --fit env1` finds these values.
ENV1 = ClumpEnvironment(
    name="env1",
    claws=Claws(
        opening_speed=0.376,  # w0 = 1 s opens a good third: why the best cycles are long ones
        closing_speed=0.259,  # slower against the load: w1 near w0 / 1.5 balances the cycle
        dead_time=0.005,  # the least the search allows: large claws, hardly any lag
    ),
    grasp=Grasp(
        weight=248.0,  # scales every g alike, so it follows from the published figures
        spread=0.136,
    ),
    pieces=24,  # the least the search allows: few heavy clumps spread g most
    piece_shape=4.59,  # pieces differ by about half their weight (1 / sqrt(shape))
    threshold_mean=0.524,  # half open
    threshold_spread=0.06,  # the least the search allows
    fall_rate=0.0759,  # open claws alone let a piece hang for half a minute
    jolt=1.26,  # so that nearly all falls come at reversals
    looseness_spread=0.367,
    entanglement=0.238,  # clumps of 1.3 pieces on average
)

# Fitted: `python -m app.crane.calibration --fit env2` finds these values.
ENV2 = GrainEnvironment(
    name="env2",
    claws=Claws(
        opening_speed=0.611,  # w0 = 0.1 s parts the claws by a twentieth: the least that pours
        closing_speed=0.557,  # slower against the load: equal times leave the claws ever wider
        dead_time=0.00755,  # small claws, hardly any lag
    ),
    grasp=Grasp(
        weight=253.0,  # holding or dropping all costs weight / sqrt(3), which bounds the mean of g
        spread=0.11,  # most of the run-to-run spread of g away from w*
    ),
    flow=9108.0,  # 5 g/s a twentieth beyond the dead gap; at a quarter, a grasp in a second
    flow_spread=0.109,  # grains run alike from run to run
    dead_gap=0.0158,  # the claws must part this far before straw runs
)

ENVIRONMENTS: Mapping[str, Environment] = MappingProxyType({"env1": ENV1, "env2": ENV2})


def environment_named(name: str) -> Environment:
    """The environment called ``name``."""
    try:
        return ENVIRONMENTS[name]
    except KeyError:
        known = ", ".join(ENVIRONMENTS)
        raise UnknownEnvironmentError(f"expected one of {known}, got {name!r}") from None


_TIMES = [round(k * TIME_STEP_S, 2) for k in range(TIME_POINTS)]
_PAIRS = np.array([(w0, w1) for w0 in _TIMES for w1 in _TIMES if w0 >= w1], dtype=np.float64)


def candidates() -> FloatArray:
    """The search space W, (231, 2): columns w0 (opening time) and w1 (closing time), in seconds.

    The paper prints ``w0 < w1``, yet says that opening takes longer than closing, and each optimum
    it reports has ``w0 >= w1``; 231 points need the diagonal too. So W holds ``w0 >= w1``.
    """
    return _PAIRS.copy()


def run_rng(environment: str, candidate_index: int, run_index: int) -> np.random.Generator:
    """The generator of one recorded run: always the same for the same three arguments."""
    names = list(ENVIRONMENTS)
    environment_named(environment)
    return np.random.default_rng(
        [LIBRARY_SEED, names.index(environment), candidate_index, run_index]
    )
