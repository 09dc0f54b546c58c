"""The problems, trials and tables that decide the default of the threshold method."""

from pathlib import Path

import numpy as np
import pytest

from app.crane import library
from app.lab.evaluators import ETA
from app.lab.problems import ACKLEY_REACH, PROBLEMS, ackley, branin, hartmann
from app.lab.variant_definitions import VARIANTS
from app.lab.variant_tables import table, with_error
from app.lab.variant_trials import LOOKS, Call, Outcome, calls, run_call
from app.lab.variants import TrialFile, main, run


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
    problem, env1 = PROBLEMS[name](), library.scores("env1")

    assert problem.candidates.shape[0] == 500
    assert problem.eta * problem.deviation == pytest.approx(ETA * env1.std())
    assert problem.failure / problem.deviation == pytest.approx(30.0 / env1.std())
    assert problem.regret(int(problem.f.argmax())) == 0.0


def test_a_trial_is_the_same_each_time_and_differs_between_seeds() -> None:
    one, two = (Call("pbpo-threshold", "branin", "uncertain", seed) for seed in (0, 1))

    found = run_call(one, queries=15)

    assert found == run_call(one, queries=15)
    assert len(found.regrets) == 2
    assert all(regret >= 0.0 for regret in found.regrets)
    assert found.regrets != run_call(two, queries=15).regrets


def test_a_stopped_run_goes_on_where_it_was(tmp_path: Path) -> None:
    wanted = calls(["pbpo-threshold"], ["branin"], ["uncertain"], range(3))
    told: list[str] = []
    begun = run(wanted, TrialFile(tmp_path), queries=10, report=told.append)
    first = next(begun)
    begun.close()
    # A crash in the middle of a line leaves half of it.
    with (tmp_path / "trials.csv").open("a") as file:
        file.write("half,a,li")

    found = list(run(wanted, TrialFile(tmp_path), queries=10, report=told.append))

    assert first in found
    assert {outcome.call for outcome in found} == set(wanted)
    assert told == ["3 trials to run", "2 trials to run"]
    assert set(TrialFile(tmp_path).outcomes()) == set(wanted)


def test_trials_of_other_settings_are_not_taken_for_these(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = Call("pbpo-threshold", "branin", "uncertain", 0)
    TrialFile(tmp_path).keep(Outcome(call, (1.0, 2.0, 3.0, 4.0)))
    assert TrialFile(tmp_path).outcomes() == {call: Outcome(call, (1.0, 2.0, 3.0, 4.0))}

    monkeypatch.setattr("app.lab.variants.ENGINE_VERSION", "another")

    assert TrialFile(tmp_path).outcomes() == {}


def test_a_cell_says_mean_median_failures_and_the_difference_on_the_same_seeds() -> None:
    limit = PROBLEMS["branin"]().failure
    found = [
        Outcome(Call("a", "branin", "uncertain", 0), (1.0,)),
        Outcome(Call("a", "branin", "uncertain", 1), (3.0,)),
        Outcome(Call("b", "branin", "uncertain", 0), (2.0,)),
        Outcome(Call("b", "branin", "uncertain", 1), (limit + 1.0,)),
    ]
    gained = with_error(np.array([1.0, limit - 2.0]), sign="+")
    reached = with_error(np.array([2.0, limit + 1.0]))

    assert table(found, 0, "a", {}).splitlines() == [
        "| | branin |",
        "|---|---|",
        "| a | 2.00 ± 1.00, median 2.00, 0.0 % (2) |",
        f"| b | {reached}, median {(limit + 3.0) / 2.0:.2f}, 50.0 % [{gained}] (2) |",
    ]


def test_the_command_prints_a_table_for_each_look(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["--trials", "1", "--queries", "10", "--first-seed", "0", "--problems", "branin"]

    main([*few, "--out", str(tmp_path), "--variants", *list(VARIANTS)[:2]])

    printed = capsys.readouterr().out
    assert f"uncertain, after {LOOKS[0]} queries" in printed
    assert printed.count("| pbpo") == 2


def test_ties_are_learned_taken_for_bad_or_forced() -> None:
    names = ["pbpo-threshold", "ties taken for both bad", "ties forced to a choice"]
    found = {
        name: run_call(Call(name, "branin", "cannot-tell", 3), queries=15).regrets for name in names
    }
    paper = run_call(Call("pbpo, paper's preset", "branin", "cannot-tell", 3), queries=15)

    assert len(set(found.values())) == 3
    assert len(paper.regrets) == 2
