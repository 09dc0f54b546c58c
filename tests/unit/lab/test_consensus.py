"""Simulated people with tastes of their own, and what methods make of their answers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.lab.consensus import RowFile, main, run
from app.lab.consensus_methods import Row, installed, judged
from app.lab.consensus_sets import CASES, PEOPLE, drawn_set, population, regret, taste
from app.lab.consensus_tables import aims, regret_table
from app.lab.people_bench import history
from app.lab.people_needed import Found, in_words, sweep
from app.lab.random_effects import abilities
from app.lab.session_people import ScoredRecording, SimulatedPeople, session_person
from app.lab.several_people import (
    PersonTraits,
    SeveralPeopleError,
    evaluator_of,
    kinds_of,
    own_taste,
    valued,
)


def test_a_set_is_the_same_each_time_and_differs_between_seeds() -> None:
    one, again, other = (drawn_set(CASES["r=0.5"], seed) for seed in (3, 3, 4))

    assert one.history() == again.history()
    assert one.history() != other.history()
    assert np.array_equal(one.f, again.f)
    assert len(one.people) == PEOPLE
    assert len(one.history()) == 10 * PEOPLE


def test_people_share_as_much_of_the_variance_of_taste_as_is_said() -> None:
    f = population(0)
    own = [valued(f, taste(0, number), 0.25) for number in range(200)]
    shared = [float(np.polyfit(f, values, 1)[0]) ** 2 for values in own]

    assert np.mean(shared) == pytest.approx(0.75, abs=0.08)
    assert np.array_equal(valued(f, taste(0, 1), 0.0), f)


def test_honest_people_say_the_same_whoever_is_beside_them() -> None:
    with_spammer, with_lefty = (drawn_set(CASES[name], 0) for name in ("spammer", "one-sided"))

    assert with_spammer.history(with_spammer.honest) == with_lefty.history(with_lefty.honest)
    assert len(with_spammer.honest) == PEOPLE - 1
    assert {answer.response for answer in with_lefty.people[-1].answers} == {"left"}


def test_a_spammer_presses_every_button_and_one_at_chance_skips_as_an_honest_person() -> None:
    rng = np.random.default_rng(0)
    pairs = [(2.0, -2.0)] * 300
    spammer = evaluator_of(PersonTraits("spammer", 0.0, 1.0), rng, 0.0, 1.0, 1.9)
    chance = evaluator_of(PersonTraits("at-chance", 0.0, 1.0), rng, 0.0, 1.0, 1.9)
    pressed = [spammer.respond(left, right, may_skip=True) for left, right in pairs]
    by_coin = [chance.respond(left, right, may_skip=True) for left, right in pairs]

    assert min(pressed.count(button) for button in ("left", "right", "skip")) > 70
    assert 110 < by_coin.count("left") < 190
    assert by_coin.count("skip") == 0
    assert chance.respond(-1.0, -2.0, may_skip=True) == "skip"


def test_a_taste_of_ones_own_is_smooth_and_as_wide_as_the_populations() -> None:
    points = np.array([(10.0 * a, b) for a in np.linspace(0, 1, 8) for b in np.linspace(2, 3, 8)])
    drawn = own_taste(points, np.random.default_rng(1))
    neighbours = np.abs(np.diff(drawn.reshape(8, 8), axis=1))

    assert drawn.std() == pytest.approx(1.0)
    assert neighbours.mean() < 0.7


def test_somebody_has_to_be_honest_and_a_share_lies_between_0_and_1() -> None:
    with pytest.raises(SeveralPeopleError, match="more than the 2 who are not reliable, got 2"):
        kinds_of(2, ("spammer", "one-sided"))
    with pytest.raises(SeveralPeopleError, match=r"a share from 0 to 1, got 1\.5"):
        valued(np.zeros(3), np.zeros(3), 1.5)


def test_a_persons_scores_share_the_studys_and_are_alike_for_runs_of_a_candidate() -> None:
    recordings = [
        ScoredRecording(10 * c + run, where, c, (float(c), c / 2.0), float(c + run))
        for where in ("near", "far")
        for c in range(4)
        for run in range(2)
    ]
    recordings = [replace(one, key=key) for key, one in enumerate(recordings)]
    alike = session_person(SimulatedPeople(2, 0.0), 0, recordings, 1, 1.9)
    own = session_person(SimulatedPeople(2, 1.0), 0, recordings, 1, 1.9)

    assert list(alike.scores.values()) == pytest.approx([one.score for one in recordings])
    assert own.scores[0] == own.scores[1]
    assert own.scores[0] != own.scores[8]
    assert own.settings["own_share"] == 1.0


def test_bradley_terry_finds_the_candidate_that_all_people_prefer() -> None:
    chosen = [
        (who, winner, loser) for who in range(4) for winner, loser in ((2, 0), (2, 1), (0, 1))
    ]
    values = abilities(chosen, 4)

    assert list(np.argsort(-values)) == [2, 0, 3, 1]
    assert values[3] == 0.0
    assert np.allclose(values.sum(), 0.0)


def test_the_shared_model_beats_models_of_ones_own_where_taste_is_shared() -> None:
    rows = [row for seed in range(2) for row in judged(seed, ["r=0"], ["shared", "own"])]
    means = {
        method: np.mean([row.consensus for row in rows if row.method == method])
        for method in ("shared", "own")
    }

    assert means["shared"] < means["own"]
    assert all(row.honest_named == 0 for row in rows if row.method == "shared")


def test_a_stopped_run_goes_on_where_it_was(tmp_path: Path) -> None:
    methods = ["pooled", "random effects"]
    file = RowFile(tmp_path, methods)
    said: list[str] = []
    first = list(run(range(1), ["r=0", "spammer"], file, methods, report=said.append))
    text = (tmp_path / "rows.csv").read_text()
    # The last line was cut off by a crash.
    (tmp_path / "rows.csv").write_text(text[:-4])
    both = list(run(range(2), ["r=0"], file, methods, report=said.append))

    assert said == ["1 sets to run", "1 sets to run"]
    assert [row for row in first if row.case == "r=0"] == [row for row in both if row.seed == 0]
    assert {row.seed for row in both} == {0, 1}
    assert RowFile(tmp_path, ["pooled"]).rows() == []


def test_the_tables_pair_methods_on_the_same_sets() -> None:
    rows = [
        Row("spammer", seed, method, regret, regret, 0.1, named, named, 0.3)
        for seed, shared in ((0, 0.1), (1, 0.3))
        for method, regret, named in (
            ("shared", shared, 1),
            ("pooled", 0.4, None),
            ("without", 0.1, None),
        )
    ]

    assert "| shared | 0.200 ± 0.100 |" in regret_table(rows, "consensus")
    assert (
        "| spammer | -0.200 ± 0.100 |  |  | +0.100 ± 0.100 | 50 % | 20.0 % | 100.0 % | 0.30 |"
        in aims(rows)
    )


def test_the_command_prints_its_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    of_one_set = ["--sets", "1", "--first-seed", "0", "--cases", "r=0.25"]
    main(["--out", str(tmp_path), *of_one_set, "--methods", "shared", "random effects"])

    printed = capsys.readouterr().out
    assert "Regret of people's own bests on their own taste" in printed
    assert "| r=0.25 | " in printed
    assert set(installed()) >= {"shared", "pooled", "own", "random effects"}


def test_the_fewest_answers_that_are_enough_are_named_for_each_way() -> None:
    found = [
        Found(3, 5, (0.3, 0.32), (0.3, 0.3), (0.5, 0.5)),
        Found(6, 5, (0.05, 0.07), (0.05, 0.16), (0.4, 0.4)),
        Found(6, 10, (0.01, 0.03), (0.05, 0.07), (0.3, 0.3)),
    ]

    assert in_words(found, 0.1) == [
        "With a shared model: 6 people of 5 answers are enough.",
        "Pooled as one person: 6 people of 10 answers are enough.",
        "With a model each: none of these is enough.",
    ]


def test_people_and_answers_are_swept_from_the_fewest_answers_on() -> None:
    found = list(sweep([3, 1], [4, 2], 0.3, [0]))

    assert [(one.people, one.answers) for one in found] == [(1, 2), (1, 4), (3, 2), (3, 4)]
    # One person alone is the same pooled and apart.
    assert found[0].pooled == found[0].own


def test_regret_is_a_share_of_the_range() -> None:
    assert regret(np.array([1.0, 3.0, 2.0]), 2) == 0.5


def test_the_history_that_is_measured_is_of_people_in_turn() -> None:
    said = history(3, 7)
    assert [who for *_, who in said] == ["p0", "p1", "p2", "p0", "p1", "p2", "p0"]
