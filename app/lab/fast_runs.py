"""Many runs of one candidate at once: the dynamics of `app.crane.dynamics`, vectorised over runs.

400 runs of each of 231 candidates take a minute one by one, and two seconds like this. The law is
the same, the random draws are others, and one thing is approximated: the hazard that a piece has
accumulated is interpolated between `THRESHOLDS` thresholds, where the simulator adds it up for each
piece's own. A test holds means and spreads of g against those of the simulator.
"""

from __future__ import annotations

from typing import Final, assert_never

import numpy as np

from app.crane.dynamics import (
    GRASP_LIMIT_DEVIATIONS,
    SAMPLES,
    STEP_S,
    STEPS,
    STEPS_PER_SAMPLE,
    ClawMotion,
    claw_motion,
)
from app.crane.environments import (
    ClumpEnvironment,
    Environment,
    FloatArray,
    GrainEnvironment,
    Grasp,
)
from app.crane.evaluation import score

#: Thresholds at which a candidate's accumulated hazard is worked out.
THRESHOLDS: Final = 256
#: They reach so many of their own deviations below their mean.
REACH: Final = 6.0


def runs_at_once(
    environment: Environment, candidate: tuple[float, float], rng: np.random.Generator, count: int
) -> FloatArray:
    """g of `count` runs of one candidate, in grams; (count,)."""
    motion = claw_motion(environment.claws, *candidate)
    match environment:
        case ClumpEnvironment():
            weight = _clumps(environment, motion, rng, count)
        case GrainEnvironment():
            weight = _grains(environment, motion, rng, count)
        case _:
            assert_never(environment)
    return score(weight)


def _grasped(grasp: Grasp, rng: np.random.Generator, count: int) -> FloatArray:
    deviation = np.clip(rng.standard_normal(count), -GRASP_LIMIT_DEVIATIONS, GRASP_LIMIT_DEVIATIONS)
    return np.asarray(grasp.weight * (1.0 + grasp.spread * deviation))


def _grains(
    environment: GrainEnvironment, motion: ClawMotion, rng: np.random.Generator, count: int
) -> FloatArray:
    """Weights (count, 501); all runs lose in the same proportions, each at its own rate."""
    initial = _grasped(environment.grasp, rng, count)
    coefficient = environment.flow * np.exp(environment.flow_spread * rng.standard_normal(count))
    gap = np.maximum(motion.opening - environment.dead_gap, 0.0)
    flow = gap * gap * np.sqrt(gap)
    lost = np.zeros(STEPS)
    np.cumsum((flow[1:] + flow[:-1]) * (0.5 * STEP_S), out=lost[1:])
    lost = lost[::STEPS_PER_SAMPLE]
    return np.asarray(np.maximum(initial[:, None] - coefficient[:, None] * lost, 0.0))


def _clumps(
    environment: ClumpEnvironment, motion: ClawMotion, rng: np.random.Generator, count: int
) -> FloatArray:
    """Weights (count, 501): each piece falls when its hazard reaches its deadline, or with its
    clump."""
    size = (count, environment.pieces)
    initial = _grasped(environment.grasp, rng, count)
    looseness = np.exp(environment.looseness_spread * rng.standard_normal((count, 1)))
    share = rng.gamma(environment.piece_shape, size=size)
    threshold = np.maximum(
        environment.threshold_mean + environment.threshold_spread * rng.standard_normal(size), 0.0
    )
    deadline = rng.standard_exponential(size) / looseness
    entangled = rng.random(size) < environment.entanglement
    entangled[:, 0] = False  # with the piece before it; the first of a run has none
    alone = _falls(environment, motion, threshold.ravel(), deadline.ravel())
    starts = np.flatnonzero(~entangled.ravel())
    clump = np.cumsum(~entangled.ravel()) - 1
    step = np.minimum.reduceat(alone, starts)[clump]
    mass = (initial[:, None] * share / share.sum(axis=1, keepdims=True)).ravel()
    # The first sample at which a piece is no longer held; SAMPLES for one that never falls.
    sample = np.minimum(-(-step // STEPS_PER_SAMPLE), SAMPLES)
    sample[step >= STEPS] = SAMPLES
    place = np.repeat(np.arange(count), environment.pieces) * (SAMPLES + 1) + sample
    fallen = np.bincount(place, weights=mass, minlength=count * (SAMPLES + 1))
    fallen = fallen.reshape(count, SAMPLES + 1)[:, :SAMPLES]
    return np.asarray(initial[:, None] - np.cumsum(fallen, axis=1))


def _falls(
    environment: ClumpEnvironment,
    motion: ClawMotion,
    threshold: FloatArray,
    deadline: FloatArray,
) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """The step at which each piece would fall by itself, STEPS if it would not; (pieces,)."""
    highest = float(motion.opening.max())
    lowest = environment.threshold_mean - REACH * environment.threshold_spread
    lowest = min(max(lowest, 0.0), highest)
    known = np.linspace(lowest, highest, THRESHOLDS)
    exposure = environment.fall_rate * STEP_S + environment.jolt * motion.jolts
    hazard = np.cumsum(np.maximum(motion.opening - known[:, None], 0.0) * exposure, axis=1)
    spacing = (highest - lowest) / (THRESHOLDS - 1)
    place = (np.maximum(threshold, lowest) - lowest) / spacing if spacing > 0.0 else threshold * 0.0
    row = np.minimum(place.astype(np.intp), THRESHOLDS - 2)
    weight = np.minimum(place - row, 1.0)
    first = np.zeros(len(threshold), dtype=np.intp)
    last = np.full(len(threshold), STEPS, dtype=np.intp)
    for _ in range(int(np.ceil(np.log2(STEPS))) + 1):
        middle = np.minimum((first + last) // 2, STEPS - 1)
        reached = (1.0 - weight) * hazard[row, middle] + weight * hazard[row + 1, middle]
        falls = (reached >= deadline) & (first < last)
        rises = ~falls & (first < last)
        last = np.where(falls, middle, last)
        first = np.where(rises, middle + 1, first)
    return first
