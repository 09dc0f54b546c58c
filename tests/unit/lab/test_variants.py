"""The problems and the table that decide the default of the threshold method."""

from pathlib import Path

import numpy as np
import pytest

from app.lab.problems import ACKLEY_REACH, PROBLEMS, ackley, branin, hartmann
from app.lab.variants import VARIANTS, Outcome, main, outcomes, table


@pytest.mark.parametrize("place", [(-np.pi, 12.275), (np.pi, 2.275), (9.42478, 2.475)])
def test_branin_has_its_three_known_maxima(place: tuple[float, float]) -> None:
    unit = np.array([[(place[0] + 5.0) / 15.0, place[1] / 15.0]])

    assert branin(unit)[0] == pytest.approx(-0.397887, abs=1e-5)


def test_ackley_has_its_known_values() -> None:
    middle = np.full((1, 4), 0.5)
    one_away = middle + 0.5 / ACKLEY_REACH

    assert ackley(middle)[0] == pytest.approx(0.0, abs=1e-12)
    assert ackley(one_away)[0] == pytest.approx(20.0 * np.expm1(-0.2), abs=1e-9)


def test_hartmann_has_its_known_maximum() -> None:
    place = np.array([[0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573]])

    assert hartmann(place)[0] == pytest.approx(3.32237, abs=1e-5)


@pytest.mark.parametrize("name", ["branin", "ackley4", "hartmann6"])
def test_every_problem_is_as_hard_to_judge_as_env1(name: str) -> None:
    problem, env1 = PROBLEMS[name](), PROBLEMS["env1"]()

    assert problem.candidates.shape[0] == 500
    assert problem.eta * problem.scores.std() == pytest.approx(env1.eta * env1.scores.std())
    assert problem.regret(int(problem.f.argmax())) == 0.0


def test_the_same_seeds_give_the_same_regrets() -> None:
    def run() -> list[Outcome]:
        return list(outcomes(["pbpo-threshold"], ["branin"], range(2), queries=7))

    found = run()

    assert found == run()
    assert all(outcome.regret >= 0.0 for outcome in found)
    assert found[0].regret != found[1].regret


def test_the_table_has_a_row_for_each_variant_and_a_column_for_each_problem() -> None:
    found = [
        Outcome("a", "env1", 0, 1.0),
        Outcome("a", "env1", 1, 3.0),
        Outcome("b", "env2", 0, 4.0),
    ]

    assert table(found).splitlines() == [
        "| | env1 | env2 |",
        "|---|---|---|",
        "| a | 2.00 +- 1.00 |  |",
        "| b |  | 4.00 |",
    ]


def test_the_command_prints_the_table_and_keeps_every_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "trials.csv"

    few = ["--trials", "2", "--queries", "2", "--problems", "branin", "--csv", str(file)]
    main([*few, "--variants", *list(VARIANTS)[:2]])

    assert capsys.readouterr().out.count("| pbpo") == 2
    assert len(file.read_text().splitlines()) == 1 + 4
