"""The box against the grid."""

from pathlib import Path

import pytest

from app.lab.boxes import BoxOutcome, main, run_box, table


@pytest.mark.parametrize("way", ["grid", "box", "box, one new"])
def test_a_trial_is_the_same_each_time(way: str) -> None:
    one, again = (run_box("ackley4", way, 1, 7) for _ in range(2))

    assert (one.regret, one.points) == (again.regret, again.points)
    assert one.regret >= 0.0
    assert one.points <= (8 if way == "box, one new" else 14)


def test_the_table_sets_the_box_against_the_grid_on_the_same_seeds() -> None:
    found = [
        BoxOutcome("env1", "grid", 0, 4.0, 50, 7.0),
        BoxOutcome("env1", "grid", 1, 6.0, 52, 7.0),
        BoxOutcome("env1", "box", 0, 3.0, 60, 20.0),
        BoxOutcome("env1", "box", 1, 3.0, 58, 22.0),
    ]

    assert table(found).splitlines()[2:] == [
        "| env1 (2) | grid | 5.00 ± 1.00 | 5.00 |  | 52 | 7 |",
        "| env1 (2) | box | 3.00 ± 0.00 | 3.00 | -2.00 ± 1.00 | 60 | 21 |",
    ]


def test_the_command_writes_every_trial(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "boxes.csv"

    few = ["--trials", "1", "--queries", "3", "--problems", "ackley4"]
    main([*few, "--out", str(file)])

    assert len(file.read_text().splitlines()) == 1 + 3
    assert capsys.readouterr().out.count("| ackley4 (1) |") == 3
