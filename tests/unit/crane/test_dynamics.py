"""The claws and what falls through them, on cases that can be worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from app.crane.dynamics import (
    DURATION_S,
    SAMPLE_RATE_HZ,
    SAMPLES,
    CandidateError,
    Pieces,
    Run,
    RunShapeError,
    claw_motion,
    simulate,
)
from app.crane.environments import (
    ENV1,
    ENV2,
    ENVIRONMENTS,
    Claws,
    Environment,
    FloatArray,
    Grasp,
    candidates,
)

CLAWS = Claws(opening_speed=2.0, closing_speed=4.0, dead_time=0.1)
T = np.arange(SAMPLES) / SAMPLE_RATE_HZ
BOTH = pytest.mark.parametrize("environment", ENVIRONMENTS.values(), ids=list(ENVIRONMENTS))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def opening(claws: Claws, w0: float, w1: float) -> FloatArray:
    return claw_motion(claws, w0, w1).opening[::2]


def test_claws_that_are_never_told_to_open_stay_closed() -> None:
    np.testing.assert_array_equal(opening(CLAWS, 0.0, 0.0), 0.0)
    np.testing.assert_array_equal(opening(CLAWS, 0.0, 0.5), 0.0)


def test_claws_that_are_only_told_to_open_open_at_their_speed_and_stop_fully_open() -> None:
    expected = np.clip(2.0 * (T - 0.1), 0.0, 1.0)
    np.testing.assert_allclose(opening(CLAWS, 0.4, 0.0), expected, atol=1e-12)


def test_claws_open_and_close_with_a_pause_at_each_reversal() -> None:
    # Still to 0.1, opening to 0.4, still to 0.5, closed at 0.65, still until it opens at 1.1.
    course = opening(CLAWS, 0.4, 0.6)
    at = {0.1: 0.0, 0.2: 0.2, 0.4: 0.6, 0.5: 0.6, 0.6: 0.2, 0.66: 0.0, 1.1: 0.0, 1.4: 0.6}
    for time, value in at.items():
        assert course[round(time * SAMPLE_RATE_HZ)] == pytest.approx(value, abs=1e-9)


def test_a_command_shorter_than_the_dead_time_moves_nothing() -> None:
    np.testing.assert_array_equal(opening(CLAWS, 0.1, 0.1), 0.0)


def test_the_course_repeats_with_the_cycle_when_the_claws_close_fully() -> None:
    course = opening(CLAWS, 0.4, 0.4)
    period = round(0.8 * SAMPLE_RATE_HZ)
    np.testing.assert_allclose(course[period:], course[:-period], atol=1e-9)


@BOTH
def test_claws_never_leave_their_range_nor_outrun_their_servo(environment: Environment) -> None:
    fastest = max(environment.claws.opening_speed, environment.claws.closing_speed)
    for w0, w1 in candidates()[::7]:
        course = opening(environment.claws, float(w0), float(w1))
        assert course.min() >= 0.0
        assert course.max() <= 1.0
        assert np.abs(np.diff(course)).max() <= fastest / SAMPLE_RATE_HZ + 1e-9


def test_each_start_of_a_movement_is_a_jolt() -> None:
    # Ten cycles of one second, each with one start of opening and one of closing.
    assert claw_motion(CLAWS, 0.4, 0.6).jolts.sum() == 20
    assert claw_motion(CLAWS, 0.4, 0.0).jolts.sum() == 1
    assert claw_motion(CLAWS, 0.0, 0.0).jolts.sum() == 0


@BOTH
def test_weight_never_grows_nor_falls_below_nothing(environment: Environment) -> None:
    for index, (w0, w1) in enumerate(candidates()[::11]):
        weight = simulate(environment, (float(w0), float(w1)), rng(index)).weight
        assert weight[0] > 0.0
        assert np.all(np.diff(weight) <= 1e-9)
        assert weight[-1] >= 0.0


@BOTH
def test_closed_claws_hold_everything(environment: Environment) -> None:
    weight = simulate(environment, (0.0, 0.0), rng()).weight
    np.testing.assert_array_equal(weight, weight[0])


@BOTH
def test_the_same_generator_gives_the_same_bytes_and_another_gives_others(
    environment: Environment,
) -> None:
    first = simulate(environment, (0.5, 0.3), rng(4))
    again = simulate(environment, (0.5, 0.3), rng(4))
    other = simulate(environment, (0.5, 0.3), rng(5))
    assert first.weight.tobytes() == again.weight.tobytes()
    assert first.opening.tobytes() == again.opening.tobytes()
    assert first.weight.tobytes() != other.weight.tobytes()


@BOTH
def test_the_grasped_weight_varies_from_run_to_run_about_its_mean(
    environment: Environment,
) -> None:
    grasped = [simulate(environment, (0.0, 0.0), rng(k)).weight[0] for k in range(300)]
    grasp = environment.grasp
    assert np.mean(grasped) == pytest.approx(grasp.weight, rel=4 * grasp.spread / np.sqrt(300))
    assert np.std(grasped) == pytest.approx(grasp.weight * grasp.spread, rel=0.25)


def grains_at(gap: float) -> float:
    """The flow in g/s through claws that stop at a constant ``gap`` beyond the dead gap."""
    # Claws that are fully open at once, so that only the dead gap sets the width of the orifice.
    world = replace(
        ENV2,
        claws=Claws(opening_speed=1e6, closing_speed=1.0, dead_time=0.0),
        grasp=Grasp(weight=1e6, spread=0.0),
        flow=100.0,
        flow_spread=0.0,
        dead_gap=1.0 - gap,
    )
    weight = simulate(world, (1.0, 0.0), rng()).weight
    return float((weight[50] - weight[450]) / (T[450] - T[50]))


def test_grains_run_out_evenly_through_a_fixed_gap_at_the_flow_of_the_orifice_law() -> None:
    assert grains_at(1.0) == pytest.approx(100.0)
    assert grains_at(0.5) == pytest.approx(100.0 * 0.5**2.5)


def test_grains_bridge_a_gap_no_wider_than_the_dead_gap() -> None:
    assert grains_at(0.0) == 0.0


def test_grains_come_without_pieces() -> None:
    assert simulate(ENV2, (0.5, 0.3), rng()).pieces is None


def clumps(seed: int = 0, w: tuple[float, float] = (1.0, 0.0), **constants: float) -> Pieces:
    pieces = simulate(replace(ENV1, **constants), w, rng(seed)).pieces  # type: ignore[arg-type]
    assert pieces is not None
    return pieces


def test_the_weight_of_clumps_is_the_sum_of_the_pieces_still_held() -> None:
    run = simulate(ENV1, (0.8, 0.4), rng(2))
    assert run.pieces is not None
    for step in (0, 50, 170, 333, 500):
        held = run.pieces.mass[run.pieces.release_time > T[step]].sum()
        assert run.weight[step] == pytest.approx(held)


def test_every_piece_weighs_something_and_together_they_are_the_grasp() -> None:
    run = simulate(ENV1, (0.8, 0.4), rng(2))
    assert run.pieces is not None
    assert np.all(run.pieces.mass > 0)
    assert run.pieces.mass.sum() == pytest.approx(run.weight[0])


def test_pieces_fall_within_the_run_or_stay_held_for_ever() -> None:
    release = clumps(w=(0.3, 0.3)).release_time
    assert np.all((release > 0) & ((release <= DURATION_S) | np.isinf(release)))


def test_no_piece_falls_through_a_gap_narrower_than_its_threshold() -> None:
    release = clumps(threshold_mean=2.0, threshold_spread=0.0).release_time
    assert np.all(np.isinf(release))


def test_pieces_fall_sooner_the_wider_the_claws_beyond_their_threshold() -> None:
    means = [
        np.mean(
            [
                np.minimum(
                    clumps(seed, threshold_mean=mean, threshold_spread=0.0).release_time, 10.0
                ).mean()
                for seed in range(20)
            ]
        )
        for mean in (0.0, 0.4, 0.8)
    ]
    assert means[0] < means[1] < means[2]


def test_fully_entangled_pieces_fall_as_one_and_loose_ones_one_by_one() -> None:
    as_one = clumps(entanglement=1.0, threshold_mean=0.2, fall_rate=1.0)
    one_by_one = clumps(entanglement=0.0, threshold_mean=0.2, fall_rate=1.0)
    assert len(np.unique(as_one.release_time)) == 1
    assert len(np.unique(one_by_one.release_time)) > 10


def test_a_jolt_shakes_pieces_loose_at_the_very_moment_of_a_reversal() -> None:
    release = clumps(
        w=(0.5, 0.5),
        fall_rate=1e-9,
        jolt=5.0,
        threshold_mean=0.0,
        threshold_spread=0.0,
        entanglement=0.0,
    ).release_time
    fallen = release[np.isfinite(release)]
    assert len(fallen) > 0
    # Movements start one dead time after each half second; a fall is noted at the next step.
    since_command = np.mod(fallen + 1e-9, 0.5)
    assert np.all(np.abs(since_command - ENV1.claws.dead_time) <= 0.01 + 1e-6)


def test_a_heavier_grasp_of_clumps_falls_in_the_same_way() -> None:
    light = simulate(ENV1, (0.8, 0.4), rng(3))
    heavy = simulate(
        replace(ENV1, grasp=Grasp(2 * ENV1.grasp.weight, ENV1.grasp.spread)), (0.8, 0.4), rng(3)
    )
    np.testing.assert_allclose(heavy.weight, 2 * light.weight)


def test_a_run_says_what_was_run_and_cannot_be_changed() -> None:
    run = simulate(ENV1, (0.8, 0.4), rng())
    assert (run.environment, run.candidate) == ("env1", (0.8, 0.4))
    assert run.weight.shape == run.opening.shape == (SAMPLES,)
    assert run.pieces is not None
    for array in (run.weight, run.opening, run.pieces.mass, run.pieces.release_time):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("w", [(-0.1, 0.2), (0.2, 11.0), (float("nan"), 0.2)])
def test_times_that_no_crane_can_follow_are_refused_with_the_pair(w: tuple[float, float]) -> None:
    with pytest.raises(CandidateError, match=r"from 0 to 10.0 s, got \("):
        simulate(ENV2, w, rng())


def test_arrays_that_are_no_recording_are_refused_with_name_and_shape() -> None:
    good = np.zeros(SAMPLES)
    with pytest.raises(RunShapeError, match=r"weight: expected shape \(501,\), got \(3,\)"):
        Run("env1", (0.1, 0.1), np.zeros(3), good, None)
    with pytest.raises(RunShapeError, match="opening: expected finite"):
        Run("env1", (0.1, 0.1), good, np.full(SAMPLES, np.nan), None)
    with pytest.raises(RunShapeError, match="one mass and one release time per piece"):
        Pieces(np.ones(3), np.ones(4))
