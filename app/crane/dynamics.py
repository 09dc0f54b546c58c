"""One run of the crane: claws open and close for ten seconds, waste leaves (Sec. V-A, V-B).

The claws follow their command exactly: constant speeds, a dead time after each reversal, saturation
at closed and fully open. What falls follows from the opening: an orifice law for grains, and for
clumps a hazard per piece that grows with the opening beyond the piece's own threshold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import assert_never

import numpy as np

from .environments import Claws, ClumpEnvironment, Environment, FloatArray, GrainEnvironment, Grasp

SAMPLE_RATE_HZ = 50
DURATION_S = 10.0
SAMPLES = 501  # t = 0, 0.02, ... 10.0
# Integration runs at twice the sample rate: phases end on multiples of 0.05 s, so on a step.
STEPS_PER_SAMPLE = 2
STEP_S = 1.0 / (SAMPLE_RATE_HZ * STEPS_PER_SAMPLE)
STEPS = (SAMPLES - 1) * STEPS_PER_SAMPLE + 1
# A grasp or a piece weighs something: draws of the grasped weight stop this many deviations out.
GRASP_LIMIT_DEVIATIONS = 2.5


class RunShapeError(ValueError):
    """A run's arrays do not have the shape or range of a recording."""


class CandidateError(ValueError):
    """A candidate is not a pair of durations."""


def _frozen(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of one grasp of clumping waste."""

    mass: FloatArray  # (p,) g
    release_time: FloatArray  # (p,) s, inf = still held at the end

    def __post_init__(self) -> None:
        if self.mass.ndim != 1 or self.mass.shape != self.release_time.shape:
            raise RunShapeError(
                "expected one mass and one release time per piece, got shapes "
                f"{self.mass.shape} and {self.release_time.shape}"
            )
        object.__setattr__(self, "mass", _frozen(self.mass))
        object.__setattr__(self, "release_time", _frozen(self.release_time))


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded run: what the load cell and the claws' encoder would have said at 50 Hz."""

    environment: str
    candidate: tuple[float, float]  # (w0 opening time, w1 closing time), s
    weight: FloatArray  # (501,) g
    opening: FloatArray  # (501,) 0 closed .. 1 fully open
    pieces: Pieces | None  # None for grains

    def __post_init__(self) -> None:
        for name in ("weight", "opening"):
            array: FloatArray = getattr(self, name)
            if array.shape != (SAMPLES,):
                raise RunShapeError(f"{name}: expected shape ({SAMPLES},), got {array.shape}")
            if not np.all(np.isfinite(array)) or array.min() < 0:
                raise RunShapeError(f"{name}: expected finite values, at least 0")
            object.__setattr__(self, name, _frozen(array))


@dataclass(frozen=True, eq=False)
class ClawMotion:
    """The claws' course over a run."""

    opening: FloatArray  # (1001,) at the integration steps
    jolts: FloatArray  # (1001,) how many times the claws started to move in the step that ends here


def simulate(
    environment: Environment, candidate: tuple[float, float], rng: np.random.Generator
) -> Run:
    """Run the crane once with opening time ``candidate[0]`` and closing time ``candidate[1]``."""
    motion = claw_motion(environment.claws, float(candidate[0]), float(candidate[1]))
    pieces: Pieces | None
    match environment:
        case ClumpEnvironment():
            pieces = _fall_in_clumps(environment, motion, rng)
            weight = _weight_of_held(pieces)
        case GrainEnvironment():
            pieces = None
            weight = _run_out(environment, motion, rng)
        case _:
            assert_never(environment)
    return Run(
        environment=environment.name,
        candidate=(float(candidate[0]), float(candidate[1])),
        weight=weight,
        opening=motion.opening[::STEPS_PER_SAMPLE],
        pieces=pieces,
    )


@lru_cache(maxsize=1024)
def claw_motion(claws: Claws, opening_time: float, closing_time: float) -> ClawMotion:
    """Follow the claws from closed, through their cycles, to the end of the run."""
    for value in (opening_time, closing_time):
        if not 0 <= value <= DURATION_S:
            raise CandidateError(
                f"expected opening and closing times from 0 to {DURATION_S} s, "
                f"got ({opening_time!r}, {closing_time!r})"
            )
    times, openings = [0.0], [0.0]
    jolts = np.zeros(STEPS)
    for start, end, speed in _phases(claws, opening_time, closing_time):
        moving_from = start + claws.dead_time
        before = openings[-1]
        limit = 1.0 if speed > 0 else 0.0
        if moving_from >= end or before == limit:
            continue
        # The phase ends at its time or where the claws meet their stop, whichever is first.
        stop = min(end, moving_from + (limit - before) / speed)
        after = limit if stop < end else before + speed * (end - moving_from)
        times += [moving_from, stop]
        openings += [before, after]
        step = int(np.ceil(moving_from / STEP_S))
        if step < STEPS:
            jolts[step] += 1.0
    grid = np.arange(STEPS) * STEP_S
    # Rounding may step past a stop by a few units in the last place.
    opening = np.clip(np.interp(grid, times, openings), 0.0, 1.0)
    return ClawMotion(opening=_frozen(opening), jolts=_frozen(jolts))


def _phases(
    claws: Claws, opening_time: float, closing_time: float
) -> list[tuple[float, float, float]]:
    """The commands as (start, end, signed speed). A phase of no length is no command."""
    if opening_time == 0 and closing_time == 0:
        return []
    if closing_time == 0:
        return [(0.0, DURATION_S, claws.opening_speed)]
    if opening_time == 0:
        return [(0.0, DURATION_S, -claws.closing_speed)]
    period = opening_time + closing_time
    phases = []
    for cycle in range(int(np.ceil(DURATION_S / period))):
        start = cycle * period
        phases.append((start, start + opening_time, claws.opening_speed))
        phases.append((start + opening_time, start + period, -claws.closing_speed))
    return phases


def _grasped(grasp: Grasp, rng: np.random.Generator) -> float:
    deviation = float(
        np.clip(rng.standard_normal(), -GRASP_LIMIT_DEVIATIONS, GRASP_LIMIT_DEVIATIONS)
    )
    return grasp.weight * (1.0 + grasp.spread * deviation)


def _run_out(
    environment: GrainEnvironment, motion: ClawMotion, rng: np.random.Generator
) -> FloatArray:
    """Beverloo's law: flow grows with the 5/2 power of the gap beyond the dead gap. (501,) g."""
    initial = _grasped(environment.grasp, rng)
    coefficient = environment.flow * float(np.exp(environment.flow_spread * rng.standard_normal()))
    gap = np.maximum(motion.opening - environment.dead_gap, 0.0)
    # x^2 sqrt(x) rather than x**2.5: a square root rounds alike on every machine, a power does not.
    flow = coefficient * gap * gap * np.sqrt(gap)  # (1001,) g/s
    lost = np.zeros(STEPS)
    np.cumsum((flow[1:] + flow[:-1]) * (0.5 * STEP_S), out=lost[1:])
    return np.maximum(initial - lost[::STEPS_PER_SAMPLE], 0.0)


def _fall_in_clumps(
    environment: ClumpEnvironment, motion: ClawMotion, rng: np.random.Generator
) -> Pieces:
    """Each piece falls when its accumulated hazard reaches its own exponential deadline.

    The pieces lie in a row; a piece that falls drags along each neighbour it is entangled with, and
    those drag theirs.
    """
    count = environment.pieces
    initial = _grasped(environment.grasp, rng)
    looseness = float(np.exp(environment.looseness_spread * rng.standard_normal()))
    share = rng.gamma(environment.piece_shape, size=count)
    threshold = environment.threshold_mean + environment.threshold_spread * rng.standard_normal(
        count
    )
    deadline = rng.standard_exponential(count) / looseness
    entangled = rng.random(count - 1) < environment.entanglement
    # Even the loosest piece needs some gap.
    threshold = np.maximum(threshold, 0.0)
    exposure = environment.fall_rate * STEP_S + environment.jolt * motion.jolts  # (1001,)
    # One (p, 1001) array, worked on in place: this is the hot line of the whole library.
    hazard = motion.opening - threshold[:, None]
    np.maximum(hazard, 0.0, out=hazard)
    hazard *= exposure
    np.cumsum(hazard, axis=1, out=hazard)
    alone = np.count_nonzero(hazard < deadline[:, None], axis=1)  # (p,) the step each would fall at
    clump_starts = np.flatnonzero(np.concatenate(([True], ~entangled)))
    clump = np.cumsum(np.concatenate(([0], ~entangled)))  # (p,)
    step = np.minimum.reduceat(alone, clump_starts)[clump]
    release = np.where(step < STEPS, step * STEP_S, np.inf)
    return Pieces(mass=initial * share / share.sum(), release_time=release)


def _weight_of_held(pieces: Pieces) -> FloatArray:
    """What the load cell reads at 50 Hz: the pieces not yet released. (501,) g."""
    times = np.arange(SAMPLES) / SAMPLE_RATE_HZ
    held: FloatArray = (pieces.release_time[:, None] > times) * pieces.mass[:, None]  # (p, 501)
    weight: FloatArray = held.sum(axis=0)
    return weight
