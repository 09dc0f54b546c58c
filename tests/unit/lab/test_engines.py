"""Where trials run makes no difference to them."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from app.lab.engines import Engine, EngineError, run_all
from app.lab.environments import World
from app.lab.experiments import Task

FIRST = Task("certain", (10, 11), "env1", "certain", "pbpo", 0, 0, 8)
TASKS = [replace(FIRST, trial=trial, seed=trial) for trial in range(4)]


def outcome(worlds: Mapping[str, World], engine: Engine, jobs: int) -> dict[str, Any]:
    return {task.name: steps for task, steps in run_all(TASKS, worlds, engine=engine, jobs=jobs)}


@pytest.mark.parametrize("engine", ["local", "dask"])
def test_two_workers_give_what_one_process_gives(
    worlds: Mapping[str, World], engine: Engine
) -> None:
    here = outcome(worlds, "local", 1)
    assert list(here) == [task.name for task in TASKS]
    assert outcome(worlds, engine, 2) == here


def test_an_engine_that_is_not_installed_is_named_with_its_extra(
    worlds: Mapping[str, World], monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(EngineError, match=r"expected ray to be installed .*pbpo-studio\[ray\]"):
        outcome(worlds, "ray", 2)


def test_an_unknown_engine_is_named(worlds: Mapping[str, World]) -> None:
    with pytest.raises(EngineError, match="expected one of local, dask, ray, got 'spark'"):
        outcome(worlds, "spark", 1)  # type: ignore[arg-type]


def test_no_workers_are_refused(worlds: Mapping[str, World]) -> None:
    with pytest.raises(EngineError, match="jobs: expected a number from 1 on, got 0"):
        outcome(worlds, "local", 0)
