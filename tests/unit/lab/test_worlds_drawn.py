"""Fresh runs and drawn cranes: the worlds that optimisers are judged on."""

from pathlib import Path

import numpy as np
import pytest

from app.crane.environments import ENV2, candidates
from app.lab import fresh_runs
from app.lab.drawn_cranes import LEAST_BEST, LEAST_TO_FIND, drawn_crane, glance
from app.lab.fresh_runs import digest, fresh_scores, runs_of


def test_fresh_runs_are_kept_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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

    monkeypatch.setattr(fresh_runs, "score", lambda weight: np.zeros(len(weight)))

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
