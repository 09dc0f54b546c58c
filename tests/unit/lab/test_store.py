"""The folder of a reproduction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from app.lab.environments import World
from app.lab.experiments import Task
from app.lab.store import OtherResultsError, Store, identity
from app.lab.trials import run_trial

TASK = Task("certain", (10, 11), "env1", "certain", "knockout", 0, 5, 6)


@pytest.fixture
def store(tmp_path: Path, worlds: Mapping[str, World]) -> Store:
    return Store(tmp_path, identity(0, worlds))


def test_a_trial_that_was_kept_is_found(store: Store, world: World) -> None:
    steps = run_trial(TASK, world)
    assert store.find(TASK) is None
    store.keep(TASK, steps)
    assert store.find(TASK) == steps


def test_a_trial_that_was_cut_short_counts_as_not_run(
    store: Store, world: World, tmp_path: Path
) -> None:
    store.keep(TASK, run_trial(TASK, world))
    path = tmp_path / "trials" / f"{TASK.name}.csv"
    path.write_text(path.read_text()[:-40])
    assert store.find(TASK) is None


def test_a_trial_of_another_length_or_seed_counts_as_not_run(store: Store, world: World) -> None:
    store.keep(TASK, run_trial(TASK, world))
    assert store.find(replace(TASK, steps=7)) is None
    assert store.find(replace(TASK, seed=6)) is None


def test_trials_of_another_seed_are_not_mixed_in(
    store: Store, tmp_path: Path, worlds: Mapping[str, World]
) -> None:
    with pytest.raises(OtherResultsError, match="seed: expected 1, got 0"):
        Store(tmp_path, identity(1, worlds))


def test_trials_on_other_recordings_are_not_mixed_in(
    store: Store, tmp_path: Path, worlds: Mapping[str, World]
) -> None:
    other = replace(worlds["env1"], scores=worlds["env1"].scores + 1.0)
    with pytest.raises(OtherResultsError, match="recordings"):
        Store(tmp_path, identity(0, {**worlds, "env1": other}))


def test_a_folder_of_something_else_is_refused(tmp_path: Path, worlds: Mapping[str, World]) -> None:
    (tmp_path / "run.json").write_text("[1, 2]")
    with pytest.raises(OtherResultsError, match="expected the record of a reproduction"):
        Store(tmp_path, identity(0, worlds))
