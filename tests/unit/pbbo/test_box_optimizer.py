"""Ask and tell in a box."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from app.pbbo import (
    Box,
    BoxOptimizer,
    BoxQuery,
    HistoryError,
    PointError,
    PreferenceOptimizer,
    QueryNotAskedError,
    Settings,
    SettingsError,
    SkipReasonError,
    SurenessError,
    UnknownMethodError,
)
from app.pbbo.candidates import FloatArray

TRIANGLE = Box(low=[0, 0], high=[1, 1], constraints=["x0 >= x1"])
PEAK = np.array([0.62, 0.35])


def bowl(point: FloatArray) -> float:
    return -float(((point - PEAK) ** 2).sum())


def run(
    optimizer: BoxOptimizer, value: Callable[[FloatArray], float], queries: int
) -> list[tuple[Any, Any, str]]:
    history = []
    for _ in range(queries):
        query = optimizer.ask()
        response = "left" if value(query.left) >= value(query.right) else "right"
        optimizer.tell(query, response)
        history.append((query.left.tolist(), query.right.tolist(), response))
    return history


def test_the_door_opens_for_a_box() -> None:
    optimizer: Any = PreferenceOptimizer(TRIANGLE, method="pbpo-threshold", seed=0)
    query = optimizer.ask()

    assert isinstance(optimizer, BoxOptimizer)
    assert query.left.shape == query.right.shape == (2,)
    assert optimizer.ask() is query
    optimizer.tell(query, "skip", reason="cannot_tell")
    history: Any = [(query.left, query.right, "skip", "cannot_tell")]
    replayed: Any = PreferenceOptimizer.replay(TRIANGLE, history, method="pbpo-threshold")
    assert replayed.ask() == optimizer.ask()


def test_the_peak_of_a_bowl_is_found_between_any_points_of_a_grid() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=1)

    run(optimizer, bowl, 25)

    assert np.linalg.norm(optimizer.best() - PEAK) < 0.05
    assert TRIANGLE.contains(optimizer.shown).all()


@pytest.mark.parametrize("corner", [(1.0, 1.0), (0.0, 0.0), (1.0, 0.0)])
def test_an_optimum_on_the_boundary_is_proposed_and_found(corner: tuple[float, float]) -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=2)

    run(optimizer, lambda point: -float(np.abs(point - corner).sum()), 20)

    assert np.abs(optimizer.best() - corner).max() < 0.03


def test_the_best_is_never_below_a_point_shown_by_mean() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=3)
    rng = np.random.default_rng(0)
    for _ in range(12):
        query = optimizer.ask()
        optimizer.tell(query, ("left", "right", "skip")[rng.integers(3)])

        best, _ = optimizer.posterior([optimizer.best()])
        shown, _ = optimizer.posterior(optimizer.shown)
        everywhere, _ = optimizer.posterior(
            [(a, b) for a in np.linspace(0, 1, 21) for b in np.linspace(0, a, 11)]
        )
        assert best[0] >= shown.max() - 1e-9
        assert best[0] >= everywhere.max() - 1e-3


def test_replayed_and_lived_optimisers_ask_the_same() -> None:
    lived = BoxOptimizer(TRIANGLE, seed=4)
    history = run(lived, bowl, 12)

    replayed = BoxOptimizer.replay(TRIANGLE, history, seed=4)

    assert replayed.ask() == lived.ask()
    np.testing.assert_array_equal(replayed.best(), lived.best())
    assert BoxOptimizer(TRIANGLE, seed=5).ask() != BoxOptimizer(TRIANGLE, seed=4).ask()


def test_with_one_new_point_a_query_shows_at_most_one_that_was_not_shown() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=1, new=1)

    for number in range(30):
        before = len(optimizer.shown)
        run(optimizer, bowl, 1)
        assert len(optimizer.shown) - before <= (2 if number == 0 else 1)

    assert len(optimizer.shown) <= 35
    assert np.linalg.norm(optimizer.best() - PEAK) < 0.1


def test_steps_are_kept_and_a_grid_is_asked_about_its_own_points() -> None:
    box = Box(low=[0, 0], high=[1, 1], step=[0.05, 0.05], constraints=["x0 >= x1"])
    optimizer = BoxOptimizer(box, seed=1)

    run(optimizer, bowl, 20)

    shown = np.vstack([optimizer.shown, optimizer.best()])
    assert shown / 0.05 == pytest.approx(np.round(shown / 0.05), abs=1e-9)
    assert np.abs(optimizer.best() - PEAK).max() <= 0.05 + 1e-9


def test_six_parameters_one_logarithmic_are_served() -> None:
    box = Box(low=[0.001, *[0.0] * 5], high=[10, *[1.0] * 5], log=[True, *[False] * 5])
    optimizer = BoxOptimizer(box, seed=1)

    run(
        optimizer,
        lambda point: -abs(np.log10(point[0])) - float(((point[1:] - 0.5) ** 2).sum()),
        25,
    )

    assert abs(np.log10(optimizer.best()[0])) < 1.0
    assert box.contains(optimizer.shown).all()


def test_an_excluded_point_is_never_proposed_nor_best_again() -> None:
    box = Box(low=[0, 0], high=[1, 1], step=[0.25, 0.25])
    optimizer = BoxOptimizer(box, seed=6)
    unsafe = [(0.5, 0.25), (0.75, 0.25)]
    for point in unsafe:
        optimizer.exclude(point)
    barred = {box.key(np.array(point)) for point in unsafe}

    for _ in range(20):
        query = optimizer.ask()
        assert not {box.key(query.left), box.key(query.right)} & barred
        run(optimizer, bowl, 1)
        assert box.key(optimizer.best()) not in barred


def test_excluding_a_point_of_the_query_that_waits_proposes_another() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=7)
    run(optimizer, bowl, 8)
    waiting = optimizer.ask()

    optimizer.exclude(waiting.left)

    other = optimizer.ask()
    assert other.index == waiting.index
    assert not any(np.array_equal(point, waiting.left) for point in (other.left, other.right))
    with pytest.raises(QueryNotAskedError):
        optimizer.tell(waiting, "left")


def test_an_exclusion_is_learnt_from_and_its_moment_does_not_matter() -> None:
    one, other = BoxOptimizer(TRIANGLE, seed=8), BoxOptimizer(TRIANGLE, seed=8)
    unsafe = (0.9, 0.1)
    before, _ = one.posterior([(0.88, 0.12)])

    one.exclude(unsafe)
    history = [([0.2, 0.1], [0.6, 0.5], "right"), ([0.9, 0.1], [0.6, 0.5], "right")]
    early = BoxOptimizer.replay(TRIANGLE, history, seed=8, excluded=[unsafe, (0.3, 0.2)])
    late = BoxOptimizer.replay(TRIANGLE, history, seed=8, excluded=[(0.3, 0.2)])
    late.exclude(unsafe)

    after, _ = one.posterior([(0.88, 0.12)])
    assert after[0] < before[0] - 0.1
    assert early.ask() == late.ask()
    assert other.posterior([unsafe])[0][0] == pytest.approx(0.0)


def test_excluding_all_but_one_point_of_a_grid_is_refused() -> None:
    box = Box(low=[0], high=[1], step=[0.5])
    optimizer = BoxOptimizer(box)
    optimizer.exclude([0.5])

    with pytest.raises(PointError, match=r"expected two points at least .*, got 1 of 3"):
        optimizer.exclude([0.0])
    assert {float(optimizer.ask().left[0]), float(optimizer.ask().right[0])} == {0.0, 1.0}


def test_sureness_rises_with_what_was_learned_and_with_what_is_tolerated() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=1)
    at_first = optimizer.sureness(0.1)

    run(optimizer, bowl, 25)

    assert optimizer.sureness(0.1) > at_first
    assert optimizer.sureness(0.0) <= optimizer.sureness(0.1) <= optimizer.sureness(1.0) == 1.0
    with pytest.raises(SurenessError, match=r"within: expected a number from 0 to 1, got 2"):
        optimizer.sureness(2)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"method": "pbpo"}, UnknownMethodError, r"expected pbpo-threshold in a box, got 'pbpo'"),
        ({"new": 3}, SettingsError, r"new: expected 1 or 2, got 3"),
        ({"new": True}, SettingsError, r"new: expected 1 or 2, got True"),
        ({"settings": {}}, SettingsError, r"settings: expected a Settings value"),
    ],
)
def test_what_a_box_cannot_be_asked_is_refused(
    given: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        BoxOptimizer(TRIANGLE, **given)


@pytest.mark.parametrize(
    ("entry", "error", "message"),
    [
        (((0.1, 0.5), (0.5, 0.1), "left"), PointError, r"history\[0\]: point: expected x0 from"),
        (((0.5, 0.1), (0.5, 0.1), "left"), HistoryError, r"two different points, got \[0.5, 0.1\]"),
        (((0.5, 0.1), "left"), HistoryError, r"expected \(left, right, response\)"),
        (((0.5, 0.1), (0.6, 0.1), "skip", "no"), SkipReasonError, r"history\[0\]: reason"),
    ],
)
def test_a_history_that_cannot_be_is_refused(
    entry: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        BoxOptimizer.replay(TRIANGLE, [entry])


def test_a_step_at_30_answers_takes_little_processor_time() -> None:
    settings = Settings()
    optimizer = BoxOptimizer(TRIANGLE, seed=1, settings=settings)
    run(optimizer, bowl, 30)
    spent = []
    for _ in range(5):
        query = optimizer.ask()
        before = time.process_time()
        optimizer.tell(query, "left")
        optimizer.ask()
        spent.append(time.process_time() - before)

    # 30 ms is the aim on an idle machine (docs/optimiser.md); this only catches a slip.
    assert min(spent) < 0.15


def same_pair(query: BoxQuery, left: Any, right: Any) -> bool:
    shown = {TRIANGLE.key(query.left), TRIANGLE.key(query.right)}
    return shown == {TRIANGLE.key(np.array(left)), TRIANGLE.key(np.array(right))}


@pytest.mark.parametrize("answered", [0, 1, 2, 3, 6, 12])
def test_a_pair_that_waits_for_its_response_is_not_proposed_again(answered: int) -> None:
    lived = BoxOptimizer(TRIANGLE, seed=5)
    history = run(lived, bowl, answered)
    waiting = lived.ask()

    late = BoxOptimizer.replay(TRIANGLE, history, seed=5, pending=[(waiting.left, waiting.right)])
    query = late.ask()

    assert query.index == answered + 1
    assert not same_pair(query, waiting.left, waiting.right)
    known = set(TRIANGLE.keys(late.shown))
    new = [point for point in (query.left, query.right) if TRIANGLE.key(point) not in known]
    assert len(new) <= 1
    again = BoxOptimizer.replay(TRIANGLE, history, seed=5, pending=[(waiting.left, waiting.right)])
    assert again.ask() == query


@pytest.mark.parametrize("answered", [0, 2, 8])
def test_an_unavailable_point_is_not_proposed_and_nothing_is_learnt_from_it(answered: int) -> None:
    lived = BoxOptimizer(TRIANGLE, seed=6)
    history = run(lived, bowl, answered)
    first = lived.ask()
    shown = set(TRIANGLE.keys(lived.shown))
    new = next(p for p in (first.left, first.right) if TRIANGLE.key(p) not in shown)

    other = BoxOptimizer.replay(TRIANGLE, history, seed=6, unavailable=[new])
    query = other.ask()

    assert TRIANGLE.key(new) not in TRIANGLE.keys(np.array([query.left, query.right]))
    if answered:
        assert np.array_equal(other.posterior([new])[0], lived.posterior([new])[0])


def test_pending_pairs_that_cannot_be_are_refused() -> None:
    with pytest.raises(HistoryError, match="two different points"):
        BoxOptimizer.replay(TRIANGLE, [], pending=[([0.5, 0.5], [0.5, 0.5])])
    with pytest.raises(HistoryError, match="pairs of points"):
        BoxOptimizer.replay(TRIANGLE, [], pending=[3])  # type: ignore[list-item]
    grid = Box(low=[0], high=[1], step=[0.5])
    with pytest.raises(PointError, match="two points at least"):
        BoxOptimizer.replay(grid, [], excluded=[[0.0]], unavailable=[[1.0]])


def test_preferences_name_rows_of_the_points_shown() -> None:
    optimizer = BoxOptimizer(TRIANGLE, seed=7)
    history = run(optimizer, bowl, 4)

    for preference, (left, right, response) in zip(optimizer.preferences, history, strict=True):
        winner, loser = (left, right) if response == "left" else (right, left)
        assert optimizer.shown[preference.winner].tolist() == winner
        assert optimizer.shown[preference.loser].tolist() == loser
