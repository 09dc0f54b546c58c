"""The search space, the two environments, and the seeds of the recorded runs."""

from dataclasses import replace

import numpy as np
import pytest

from app.crane.environments import (
    ENV1,
    ENV2,
    ENVIRONMENTS,
    Claws,
    EnvironmentConstantError,
    Grasp,
    UnknownEnvironmentError,
    candidates,
    environment_named,
    run_rng,
)


def test_the_search_space_holds_231_pairs_in_which_opening_takes_at_least_as_long() -> None:
    w = candidates()
    assert w.shape == (231, 2)
    assert np.all(w[:, 0] >= w[:, 1])
    assert len(np.unique(w, axis=0)) == 231


def test_candidates_are_ordered_by_opening_then_closing_time() -> None:
    pairs = [tuple(pair) for pair in candidates().tolist()]
    assert pairs == sorted(pairs)
    assert pairs[0] == (0.0, 0.0)
    assert pairs[-1] == (1.0, 1.0)


def test_candidates_are_the_two_decimal_numbers_that_people_write() -> None:
    pairs = candidates().tolist()
    for published in ([0.95, 0.6], [0.1, 0.1], [0.9, 0.25], [1.0, 0.5], [0.25, 0.25]):
        assert published in pairs


def test_changing_a_candidate_array_does_not_change_the_search_space() -> None:
    candidates()[:] = 7.0
    assert candidates().max() == 1.0


def test_each_environment_is_found_under_its_own_name() -> None:
    assert list(ENVIRONMENTS) == ["env1", "env2"]
    for name in ENVIRONMENTS:
        assert environment_named(name).name == name


def test_an_unknown_environment_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(UnknownEnvironmentError, match="one of env1, env2, got 'env3'"):
        environment_named("env3")
    with pytest.raises(UnknownEnvironmentError):
        run_rng("env3", 0, 0)


def test_the_table_of_environments_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        ENVIRONMENTS["env1"] = ENV2  # type: ignore[index]


@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), float("inf")])
def test_claws_that_cannot_exist_are_refused_with_field_and_value(value: float) -> None:
    with pytest.raises(EnvironmentConstantError, match=r"Claws\.closing_speed: .* got"):
        Claws(opening_speed=1.0, closing_speed=value, dead_time=0.0)


def test_constants_outside_nature_are_refused() -> None:
    with pytest.raises(EnvironmentConstantError, match=r"Grasp\.spread"):
        Grasp(weight=100.0, spread=-0.1)
    with pytest.raises(EnvironmentConstantError, match=r"ClumpEnvironment\.entanglement"):
        replace(ENV1, entanglement=1.5)
    with pytest.raises(EnvironmentConstantError, match=r"ClumpEnvironment\.pieces"):
        replace(ENV1, pieces=0)
    with pytest.raises(EnvironmentConstantError, match=r"GrainEnvironment\.flow"):
        replace(ENV2, flow=0.0)


def test_a_recorded_run_always_draws_from_the_same_generator() -> None:
    first, second = run_rng("env1", 12, 3), run_rng("env1", 12, 3)
    np.testing.assert_array_equal(first.random(8), second.random(8))


def test_different_recorded_runs_draw_different_numbers() -> None:
    keys = [("env1", 12, 3), ("env2", 12, 3), ("env1", 13, 3), ("env1", 12, 4), ("env1", 3, 12)]
    draws = {run_rng(*key).random() for key in keys}
    assert len(draws) == len(keys)
