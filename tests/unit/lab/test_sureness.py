"""Calibration of how sure the optimiser says it is."""

from pathlib import Path

import pytest

from app.lab.sureness import Said, calibration, main, sets, stopping


def said(seed: int, query: int, sure: float, *, right: bool, regret: float) -> Said:
    return Said("env1", "uncertain", seed, query, sure, right, 7, True, regret)


def test_what_was_said_is_set_against_what_was_true_in_tenths() -> None:
    trials = [
        said(0, 30, 0.92, right=True, regret=1.0),
        said(1, 30, 0.98, right=False, regret=9.0),
        said(2, 30, 1.0, right=True, regret=1.0),
        said(3, 30, 0.1, right=False, regret=9.0),
        said(3, 9, 0.1, right=True, regret=9.0),
    ]

    assert calibration(trials).splitlines()[2:] == [
        "| 0.1 to 0.2 | 1 | 0.10 | 0.00 | 0.00 |",
        "| 0.9 to 1.0 | 3 | 0.97 | 0.67 | 0.27 |",
    ]


def test_a_trial_ends_at_the_first_query_that_is_sure_enough() -> None:
    one = [
        said(0, query, sure, right=True, regret=30.0 - query)
        for query, sure in ((10, 0.5), (11, 0.97), (12, 0.6))
    ]
    other = [said(1, query, 0.5, right=True, regret=2.0) for query in (10, 11, 12)]

    assert stopping([*one, *other], (0.95, 0.99)).splitlines()[2:] == [
        "| env1 (2) | 0.95 | 50 % | 11.5 | 10.50 | 10.00 | +0.50 ± 0.50 |",
        "| env1 (2) | 0.99 | 0 % | 12.0 | 10.00 | 10.00 | +0.00 ± 0.00 |",
    ]
    assert sets([*one, *other]).splitlines()[2:] == ["| env1 | 2 | 7 | 100 % |"]


def test_the_command_writes_what_trials_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "said.csv"

    few = ["--trials", "1", "--queries", "11", "--problems", "branin"]
    main([*few, "--out", str(file)])

    assert len(file.read_text().splitlines()) == 1 + 11
    assert "| branin (1) | " in capsys.readouterr().out
