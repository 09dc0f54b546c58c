"""A reproduction from end to end, small: killed and gone on with, whole and reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from app.lab.experiments import EXPERIMENTS
from app.lab.reproduce import reproduce, run
from app.lab.results import Results
from app.lab.steps import from_csv

SMALL = [replace(experiment, steps=8) for experiment in EXPERIMENTS]


class KilledError(Exception):
    """What a test kills a run with."""


def run_small(folder: Path, stop_after: int | None = None, jobs: int = 1) -> Results:
    def progress(done: int, total: int) -> None:
        assert total == 12
        if done == stop_after:
            raise KilledError

    return run(
        folder,
        (10,),
        trials=2,
        seed=3,
        jobs=jobs,
        engine="local",
        experiments=SMALL,
        progress=progress,
    )


def test_a_killed_run_goes_on_and_ends_as_one_that_was_not(tmp_path: Path) -> None:
    run_small(tmp_path / "whole")
    for stop in (2, 5):
        with pytest.raises(KilledError):
            run_small(tmp_path / "killed", stop_after=stop)
        assert len(list((tmp_path / "killed" / "trials").glob("*.csv"))) == stop
    kept = {
        path: path.stat().st_mtime_ns for path in (tmp_path / "killed" / "trials").glob("*.csv")
    }
    run_small(tmp_path / "killed")
    whole, resumed = (tmp_path / name / "steps.csv" for name in ("whole", "killed"))
    assert resumed.read_bytes() == whole.read_bytes()
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())


def test_the_table_has_every_step_of_every_trial(tmp_path: Path) -> None:
    run_small(tmp_path)
    steps = from_csv((tmp_path / "steps.csv").read_text())
    assert len(steps) == 12 * 8
    assert {step.figures for step in steps} == {"10 11"}


def test_a_report_of_what_was_asked_for_is_written(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    path = reproduce(
        tmp_path, figures=(9, 21), trials=2, progress=lambda done, total: seen.append((done, total))
    )
    assert path == tmp_path / "report.md"
    text = path.read_text(encoding="utf-8")
    assert "## Figure 9" in text
    assert "## Figure 21" in text
    assert "## Figure 10" not in text
    assert seen[-1] == (4, 4)
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        "fig9.svg",
        "fig9.png",
        "fig21.svg",
        "fig21.png",
    }
