"""Candidates, settings, seeds and histories that are refused, and what the refusal says."""

import subprocess
import sys
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from app.pbbo import (
    PRESETS,
    CandidatesError,
    HistoryError,
    PbboError,
    PreferenceOptimizer,
    SeedError,
    Settings,
    SettingsError,
)
from app.pbbo.settings import ordinary_length_scale

LINE = np.linspace(0.0, 1.0, 6)[:, None]


@pytest.mark.parametrize(
    ("candidates", "message"),
    [
        ([1.0, 2.0], "2-D array .* got 1-D of shape"),
        ([[[1.0]]], "got 3-D"),
        ([[1.0]], "at least 2 rows and 1 column, got 1 rows"),
        (np.zeros((3, 0)), "got 3 rows and 0 columns"),
        ([[0.0], [np.nan]], "finite numbers, got nan in row 1, column 0"),
        ([[0.0, np.inf], [1.0, 2.0]], "got inf in row 0, column 1"),
        ([[0.0, 1.0], [2.0, 3.0], [0.0, 1.0]], "rows 0 and 2 both"),
        ([[0.0], [-0.0]], "rows 0 and 1 both"),
        ([["a"], ["b"]], "array of numbers"),
        ([[0.0], [1.0, 2.0]], "array of numbers"),
        (None, "got 0-D"),
    ],
)
def test_candidates_that_are_no_search_space_are_refused(candidates: Any, message: str) -> None:
    with pytest.raises(CandidatesError, match=message):
        PreferenceOptimizer(candidates)


def test_the_caller_s_array_stays_their_own() -> None:
    candidates = np.array([[0.0], [0.5], [2.0]])
    optimizer = PreferenceOptimizer(candidates)
    first = optimizer.ask()

    candidates[:] = np.nan

    assert optimizer.ask() == first
    optimizer.tell(first, "left")
    assert np.isfinite(optimizer.posterior()[0]).all()


@pytest.mark.parametrize("seed", [-1, 1.5, "0", None, True, 2**63])
def test_a_seed_that_cannot_be_recorded_is_refused(seed: Any) -> None:
    with pytest.raises(SeedError, match="seed: expected"):
        PreferenceOptimizer(LINE, seed=seed)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"length_scale": 0.0}, "length_scale: expected a finite number above 0, got 0.0"),
        ({"length_scale": float("nan")}, "length_scale"),
        ({"length_scale": "0.1"}, "length_scale: expected a number above 0, got '0.1'"),
        ({"length_scale": 1e9}, "length_scale: expected 0.0001 to 1000"),
        ({"epsilon": -0.01}, "epsilon"),
        ({"epsilon": 1e-9}, "epsilon: expected sqrt"),
        ({"epsilon": True}, "epsilon"),
        ({"signal_variance": float("inf")}, "signal_variance"),
        ({"random_queries": -1}, "random_queries: expected a whole number"),
        ({"random_queries": 2.5}, "random_queries"),
        ({"optimise_kernel": 1}, "optimise_kernel: expected true or false, got 1"),
        ({"acquisition": "ucb"}, "acquisition: expected one of thompson, got 'ucb'"),
        ({"lengthscale": 0.1}, "'lengthscale': expected a setting, one of preset, length_scale"),
        ({"preset": "paper"}, "preset: expected one of paper-env1, paper-env2, got 'paper'"),
        ({"preset": ["paper-env1"]}, "preset"),
    ],
)
def test_a_setting_that_cannot_be_meant_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Settings.from_mapping(given)


def test_a_preset_is_a_start_that_other_keys_override() -> None:
    settings = Settings.from_mapping({"preset": "paper-env2", "epsilon": 0.5})

    assert settings.epsilon == 0.5
    assert settings.length_scale == PRESETS["paper-env2"].length_scale


def test_settings_survive_being_written_down() -> None:
    settings = Settings(length_scale=0.3, optimise_kernel=True)

    assert Settings.from_mapping(settings.to_mapping()) == settings


def test_settings_cannot_be_changed_later() -> None:
    with pytest.raises(FrozenInstanceError):
        Settings().epsilon = 1.0  # type: ignore[misc]


def test_the_paper_s_presets_hold_its_settings_in_the_ordinary_convention() -> None:
    assert ordinary_length_scale(0.01) == pytest.approx(0.1)
    assert PRESETS["paper-env1"].length_scale == PRESETS["paper-env2"].length_scale
    assert PRESETS["paper-env1"].length_scale == pytest.approx(0.1)
    assert (PRESETS["paper-env1"].epsilon, PRESETS["paper-env2"].epsilon) == (0.01, 0.0001)
    assert {preset.random_queries for preset in PRESETS.values()} == {5}


def test_settings_of_another_kind_are_refused() -> None:
    with pytest.raises(SettingsError, match="expected a Settings value"):
        PreferenceOptimizer(LINE, settings={"epsilon": 1.0})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("history", "message"),
    [
        ([(0, 1, "left"), (0, 6, "left")], r"history\[1\]: expected candidates from 0 to 5, got 6"),
        ([(-1, 1, "left")], r"history\[0\]: expected candidates from 0 to 5, got -1"),
        ([(0.0, 1, "left")], r"history\[0\]"),
        ([(2, 2, "left")], r"history\[0\]: expected two different candidates, got 2"),
        ([(0, 1)], r"history\[0\]: expected \(left, right, response\)"),
        ([(0, 1, "Left")], r"history\[0\]: response: expected left, right or skip, got 'Left'"),
    ],
)
def test_a_history_that_cannot_have_happened_is_refused(history: Any, message: str) -> None:
    with pytest.raises(PbboError, match=message):
        PreferenceOptimizer.replay(LINE, history)
    if "response" not in message:
        with pytest.raises(HistoryError):
            PreferenceOptimizer.replay(LINE, history)


def test_units_of_a_parameter_do_not_matter_unless_scaling_is_off() -> None:
    history = [(0, 3, "left"), (1, 4, "right"), (4, 5, "left")]
    metres = np.random.default_rng(0).uniform(size=(6, 2))
    millimetres = metres * [1000.0, 1.0] + [5.0, 0.0]

    scaled = [PreferenceOptimizer.replay(c, history).posterior()[0] for c in (metres, millimetres)]
    raw = [
        PreferenceOptimizer.replay(c, history, settings=Settings(scale_candidates=False))
        for c in (metres, millimetres)
    ]

    assert scaled[0] == pytest.approx(scaled[1], abs=1e-6)
    assert raw[0].posterior()[0] != pytest.approx(raw[1].posterior()[0], abs=1e-3)


def test_a_parameter_that_never_varies_does_no_harm() -> None:
    with_constant = np.hstack([LINE, np.full_like(LINE, 7.0)])
    history = [(0, 3, "left"), (1, 4, "right")]

    plain, padded = (
        PreferenceOptimizer.replay(c, history).posterior()[0] for c in (LINE, with_constant)
    )

    assert plain == pytest.approx(padded)


def test_importing_the_room_is_light() -> None:
    program = "import sys, app.pbbo; print([m for m in ('torch', 'scipy') if m in sys.modules])"

    out = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )

    assert out.stdout.strip() == "[]"
