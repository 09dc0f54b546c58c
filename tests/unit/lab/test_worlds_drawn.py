"""Fresh runs and drawn cranes: the worlds that optimisers are judged on."""

from pathlib import Path

import numpy as np
import pytest

from app.crane.dynamics import simulate
from app.crane.environments import ENV1, ENV2, Environment, candidates
from app.crane.evaluation import score
from app.lab import fresh_runs
from app.lab.drawn_cranes import LEAST_BEST, LEAST_TO_FIND, drawn_crane, glance
from app.lab.fast_runs import runs_at_once
from app.lab.fresh_runs import digest, fresh_scores, runs_of


@pytest.mark.parametrize("environment", [ENV1, ENV2], ids=lambda one: one.name)
@pytest.mark.parametrize("w", [(1.0, 0.6), (0.1, 0.1), (0.3, 0.0), (0.0, 0.0)])
def test_runs_at_once_have_the_mean_and_spread_of_the_simulator(
    environment: Environment, w: tuple[float, float]
) -> None:
    rng = np.random.default_rng(2)
    one_by_one = score(np.array([simulate(environment, w, rng).weight for _ in range(200)]))

    at_once = runs_at_once(environment, w, np.random.default_rng(1), 4000)

    error = one_by_one.std() / np.sqrt(200)
    assert at_once.mean() == pytest.approx(one_by_one.mean(), abs=4.0 * error)
    assert at_once.std() == pytest.approx(one_by_one.std(), rel=0.25)


def test_fresh_runs_are_kept_and_read_again(tmp_path: Path) -> None:
    made = fresh_scores(ENV2, 2, tmp_path)

    assert made.shape == (len(candidates()), 2)
    assert [file.name for file in tmp_path.iterdir()] == [f"{digest(ENV2, 2)}.npy"]
    marked = np.load(tmp_path / f"{digest(ENV2, 2)}.npy") + 1.0
    np.save(tmp_path / f"{digest(ENV2, 2)}.npy", marked)
    np.testing.assert_array_equal(fresh_scores(ENV2, 2, tmp_path), made + 1.0)


def test_runs_of_another_simulator_are_not_taken_for_these(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = digest(ENV2, 2)

    monkeypatch.setattr(fresh_runs, "runs_at_once", lambda *given: np.zeros(given[3]))

    assert digest(ENV2, 2) != before


def test_a_fresh_run_depends_on_nothing_but_its_arguments() -> None:
    first = runs_of(ENV2, (0.1, 0.1), 7, 3)

    np.testing.assert_array_equal(first, runs_of(ENV2, (0.1, 0.1), 7, 3))
    assert len(set(first)) == 3
    assert not np.array_equal(first, runs_of(ENV2, (0.1, 0.1), 8, 3))


@pytest.mark.parametrize("number", [0, 1])
def test_a_drawn_crane_is_always_the_same_and_has_something_to_find(number: int) -> None:
    crane = drawn_crane(number)

    assert crane.name == ("env1", "env2")[number % 2]
    f = glance(crane)
    assert f.max() - f.mean() >= LEAST_TO_FIND
    assert f.max() >= LEAST_BEST
    drawn_crane.cache_clear()
    assert drawn_crane(number) == crane
    assert drawn_crane(number + 2) != crane
