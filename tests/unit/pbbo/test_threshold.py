"""The acceptability threshold: what skips and choices say of it, and what it says of candidates."""

from typing import Literal

import numpy as np
import pytest

from app.pbbo import PreferenceOptimizer, Settings, SettingsError, SkipReasonError
from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.comparisons import Comparison
from app.pbbo.model_averaging import Average, average_over, joint_draws
from app.pbbo.preferences import Response
from app.pbbo.quasi_random import quasi_random_candidates
from app.pbbo.skip_synthesis import Learned
from app.pbbo.threshold import with_threshold

STEP = 0.05
TRIANGLE: FloatArray = np.array([(i * STEP, j * STEP) for i in range(21) for j in range(i + 1)])
FEW: FloatArray = np.array([[0.0], [0.4], [1.0]])

History = list[tuple[int, int, Response]]


def belief(history: History, points: FloatArray = TRIANGLE) -> Average:
    learned = Learned(seed=0, synthesise=False)
    for index, (left, right, response) in enumerate(history):
        learned.record(index, left, right, response)
    candidates = Candidates.from_array(points, scale=True)
    return average_over(candidates, learned.preferences, learned.skips, Settings())


def test_a_choice_lies_above_the_threshold_and_a_skip_below() -> None:
    learned = Learned(seed=0, synthesise=False)
    learned.record(0, 3, 4, "right")
    learned.record(1, 1, 2, "skip")

    assert with_threshold(learned.preferences, learned.skips, 9) == [
        Comparison(4, 3),
        Comparison(4, 9),
        Comparison(9, 1),
        Comparison(9, 2),
    ]


def test_once_there_is_a_tie_choices_are_wider_than_the_tie_width() -> None:
    learned = Learned(seed=0, synthesise=False)
    learned.record(0, 3, 4, "right")
    learned.record(1, 1, 2, "skip", "cannot_tell")

    assert with_threshold(learned.preferences, learned.skips, 9) == [
        Comparison(4, 3, -1),
        Comparison(4, 9),
        Comparison(1, 2, 1),
        Comparison(2, 1, 1),
    ]


def test_after_skips_the_threshold_lies_above_what_was_skipped() -> None:
    skipped = [(0, 20), (50, 60), (100, 5)]

    after = belief([(a, b, "skip") for a, b in skipped])

    threshold, _ = after.threshold
    assert threshold > 0.0
    for candidate in np.ravel(skipped):
        assert after.mean[candidate] < 0.0 < threshold


def test_after_choices_the_chosen_lie_above_the_threshold() -> None:
    after = belief([(0, 20, "left"), (50, 60, "left"), (100, 5, "left")])

    threshold, _ = after.threshold
    assert threshold < 0.0
    for chosen in (0, 50, 100):
        assert after.mean[chosen] > threshold


def test_a_skip_moves_the_belief_away_from_both_before_anything_was_chosen() -> None:
    optimizer = PreferenceOptimizer.replay(
        TRIANGLE, [(0, 1, "skip"), (2, 5, "skip")], method="pbpo-threshold"
    )

    best = optimizer.best()

    mean, _ = optimizer.posterior()
    assert mean[best] > mean[[0, 1, 2, 5]].max()
    assert np.linalg.norm(TRIANGLE[best] - TRIANGLE[1]) > 0.2


def test_swapping_the_sides_of_every_query_changes_nothing() -> None:
    history: History = [(0, 100, "left"), (30, 100, "right"), (7, 8, "skip"), (9, 5, "left")]
    other: dict[Response, Response] = {"left": "right", "right": "left", "skip": "skip"}
    swapped: History = [(b, a, other[response]) for a, b, response in history]

    one, two = belief(history), belief(swapped)

    np.testing.assert_array_equal(one.mean, two.mean)
    np.testing.assert_array_equal(one.std, two.std)
    assert one.threshold == two.threshold


def test_the_order_of_the_responses_changes_nothing() -> None:
    history: History = [(0, 100, "left"), (30, 100, "right"), (7, 8, "skip"), (9, 5, "left")]

    one, two = belief(history), belief(history[::-1])

    np.testing.assert_array_equal(one.mean, two.mean)


def test_the_mixture_weighs_the_length_scales_by_their_evidence() -> None:
    rng = np.random.default_rng(4)
    wave = np.sin(20.0 * TRIANGLE[:, 0]) * np.sin(20.0 * TRIANGLE[:, 1])
    slope = TRIANGLE[:, 0]
    weighted = {}
    for name, taste in (("wave", wave), ("slope", slope)):
        history: History = []
        for _ in range(60):
            a, b = (int(i) for i in rng.choice(len(TRIANGLE), 2, replace=False))
            history.append((a, b, "left" if taste[a] >= taste[b] else "right"))
        after = belief(history)
        assert after.weights.sum() == pytest.approx(1.0)
        weighted[name] = after.weights @ np.log([part.prior.length_scale for part in after.parts])

    assert weighted["wave"] < weighted["slope"]


def test_functions_drawn_from_the_mixture_have_its_mean_and_spread() -> None:
    after = belief([(0, 100, "left"), (30, 100, "right"), (7, 8, "skip"), (9, 5, "left")])

    drawn = joint_draws(after, np.random.default_rng(0), 4000, np.arange(len(TRIANGLE)))

    assert drawn.shape == (len(TRIANGLE), 4000)
    np.testing.assert_allclose(drawn.mean(axis=1), after.mean, atol=0.08)
    np.testing.assert_allclose(drawn.std(axis=1), after.std, atol=0.08)


def test_the_same_history_and_seed_give_the_same_queries() -> None:
    settings = Settings(random_queries=3)

    def walk() -> list[tuple[int, int, str]]:
        optimizer = PreferenceOptimizer(TRIANGLE, "pbpo-threshold", 5, settings)
        asked = []
        for _ in range(9):
            query = optimizer.ask()
            asked.append((query.left, query.right, query.acquisition))
            both_low = max(TRIANGLE[query.left, 0], TRIANGLE[query.right, 0]) < 0.4
            left_wins = TRIANGLE[query.left, 0] >= TRIANGLE[query.right, 0]
            optimizer.tell(query, "skip" if both_low else "left" if left_wins else "right")
        return asked

    assert walk() == walk()
    assert walk()[-1][2] == "best-option"


@pytest.mark.parametrize(
    "history",
    [
        [(0, 1, "left")] * 40,
        [(0, 1, "left"), (0, 1, "right")] * 20,
        [(0, 1, "skip")] * 40,
        [(0, 1, "skip"), (0, 1, "left"), (1, 2, "skip"), (2, 1, "right")] * 10,
    ],
)
def test_one_sided_contradictory_and_skipped_answers_leave_a_usable_belief(
    history: History,
) -> None:
    optimizer = PreferenceOptimizer.replay(
        FEW, history, method="pbpo-threshold", settings=Settings(random_queries=0)
    )

    query = optimizer.ask()

    mean, std = optimizer.posterior()
    assert np.isfinite(mean).all()
    assert (std > 0.0).all()
    assert query.trial_type == "model"
    assert {query.left, query.right} != set(history[-1][:2])
    assert 0 <= optimizer.best() < len(FEW)


def test_two_candidates_and_six_dimensions_are_served() -> None:
    settings = Settings(threshold_covering=0, random_queries=0)
    pair = PreferenceOptimizer([[0.0], [1.0]], "pbpo-threshold", 1, settings)
    for _ in range(4):
        pair.tell(pair.ask(), "left")
    assert {pair.ask().left, pair.ask().right} == {0, 1}

    points = np.random.default_rng(0).random((700, 6))
    many = PreferenceOptimizer(points, "pbpo-threshold", 1, settings)
    for response in ("left", "skip", "right"):
        query = many.ask()
        assert query.trial_type == "model"
        many.tell(query, response)


@pytest.mark.parametrize(("design", "reach"), [("sobol", 0.4), ("farthest", 0.3)])
def test_the_first_queries_cover_the_space_whatever_is_answered(
    design: Literal["sobol", "farthest"], reach: float
) -> None:
    settings = Settings(threshold_covering=5, threshold_design=design)
    shown: list[list[int]] = []
    for response in ("left", "skip"):
        optimizer = PreferenceOptimizer(TRIANGLE, "pbpo-threshold", 8, settings)
        seen: list[int] = []
        for _ in range(5):
            query = optimizer.ask()
            assert (query.trial_type, query.acquisition) == ("random", "covering")
            seen += [query.left, query.right]
            optimizer.tell(query, response)
        assert optimizer.ask().trial_type == "model"
        shown.append(seen)

    assert shown[0] == shown[1]
    away = np.linalg.norm(TRIANGLE[:, None] - TRIANGLE[shown[0]][None], axis=2)
    assert len(set(shown[0])) == 10
    assert away.min(axis=1).max() < reach


@pytest.mark.parametrize("d", [1, 4, 8])
def test_sobol_points_are_spread_more_evenly_than_random_ones(d: int) -> None:
    points = np.random.default_rng(0).random((500, d))
    gaps = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        for rows in (quasi_random_candidates(rng, points, 8), rng.permutation(500)[:8]):
            assert len(set(rows)) == 8
            away = np.linalg.norm(points[rows][:, None] - points[rows][None], axis=2)
            gaps.append(away[np.triu_indices(8, 1)].min())

    assert np.mean(gaps[::2]) > np.mean(gaps[1::2])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"threshold_length_scales": []}, r"threshold_length_scales: expected a list of at least"),
        ({"threshold_length_scales": [0.1, 0.0]}, r"threshold_length_scales\[1\]: expected"),
        ({"threshold_length_scales": 0.1}, r"threshold_length_scales: expected a list"),
        ({"threshold_length_scales": [1e-9]}, r"length_scale: expected 0.0001 to"),
        ({"threshold_epsilon": 1e-9}, r"threshold_epsilon: expected sqrt"),
        ({"threshold_noise": 0}, r"threshold_noise: expected a finite number above 0"),
        ({"threshold_noise": 1e-3}, r"threshold_noise: expected 0.01 to 100"),
        ({"threshold_covering": 1.5}, r"threshold_covering: expected a whole number"),
        ({"threshold_epsilon": "quiet"}, r"threshold_epsilon: expected a number"),
        ({"threshold_design": "grid"}, r"threshold_design: expected sobol or farthest, got 'grid'"),
        ({"threshold_skip_means": "bad"}, r"threshold_skip_means: expected both_bad or cannot"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(given: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Settings.from_mapping(given)


def test_settings_read_from_a_plan_may_give_lists() -> None:
    settings = Settings.from_mapping({"threshold_length_scales": [0.1, 0.3]})

    assert settings.threshold_length_scales == (0.1, 0.3)
    assert Settings.from_mapping(settings.to_mapping()) == settings


def test_ties_and_choices_teach_the_width_of_a_tie() -> None:
    """An evaluator who cannot tell values apart that differ by less than a fifth."""
    rng = np.random.default_rng(2)
    taste = TRIANGLE[:, 0]
    widths = {}
    for width in (0.05, 0.4):
        optimizer = PreferenceOptimizer(TRIANGLE, "pbpo-threshold", 1)
        history: list[tuple[int, int, str, str | None]] = []
        for _ in range(40):
            a, b = (int(i) for i in rng.choice(len(TRIANGLE), 2, replace=False))
            if abs(taste[a] - taste[b]) < width:
                history.append((a, b, "skip", "cannot_tell"))
            else:
                history.append((a, b, "left" if taste[a] > taste[b] else "right", None))
        optimizer = PreferenceOptimizer.replay(TRIANGLE, history, method="pbpo-threshold")
        after = optimizer._believe()
        assert isinstance(after, Average)
        span = after.mean.max() - after.mean.min()
        widths[width] = after.tie_width[0] / span

    assert widths[0.05] < widths[0.4]
    assert widths[0.4] == pytest.approx(0.4, abs=0.15)


def test_a_tie_brings_two_candidates_together_and_a_bad_pair_puts_both_down() -> None:
    told: list[tuple[int, int, str]] = [(0, 230, "right"), (0, 120, "right")]
    tie = PreferenceOptimizer.replay(
        TRIANGLE, [*told, (120, 230, "skip", "cannot_tell")], method="pbpo-threshold"
    )
    bad = PreferenceOptimizer.replay(
        TRIANGLE, [*told, (120, 230, "skip", "both_bad")], method="pbpo-threshold"
    )
    before = PreferenceOptimizer.replay(TRIANGLE, told, method="pbpo-threshold")

    level = [each.posterior()[0][[120, 230]].mean() for each in (tie, bad, before)]
    spread = [each.posterior()[1][[120, 230]].mean() for each in (tie, before)]
    assert level[1] < level[2] - 0.1
    assert level[0] == pytest.approx(level[2], abs=0.2)
    assert spread[0] < spread[1]


def test_a_skip_without_a_reason_means_what_the_settings_say() -> None:
    told: list[tuple[int, int, str]] = [(0, 230, "right"), (5, 60, "skip")]
    given: list[tuple[int, int, str, str]] = [(5, 60, "skip", "cannot_tell")]
    settings = Settings(threshold_skip_means="cannot_tell")

    unsaid = PreferenceOptimizer.replay(TRIANGLE, told, method="pbpo-threshold", settings=settings)
    said = PreferenceOptimizer.replay(TRIANGLE, [told[0], *given], method="pbpo-threshold")
    bad = PreferenceOptimizer.replay(TRIANGLE, told, method="pbpo-threshold")

    np.testing.assert_array_equal(unsaid.posterior()[0], said.posterior()[0])
    assert not np.allclose(bad.posterior()[0], said.posterior()[0])


def test_a_skip_told_with_a_reason_is_the_one_replayed() -> None:
    told = PreferenceOptimizer(TRIANGLE, "pbpo-threshold", 3)
    history: list[tuple[int, int, str, str | None]] = []
    for response, reason in (("skip", "cannot_tell"), ("left", None), ("skip", "both_bad")):
        query = told.ask()
        told.tell(query, response, reason=reason)
        history.append((query.left, query.right, response, reason))

    replayed = PreferenceOptimizer.replay(TRIANGLE, history, method="pbpo-threshold", seed=3)

    np.testing.assert_array_equal(told.posterior()[0], replayed.posterior()[0])
    assert told.ask() == replayed.ask()


@pytest.mark.parametrize(
    ("method", "response", "reason", "message"),
    [
        ("pbpo-threshold", "skip", "boring", r"expected both_bad or cannot_tell or none, got 'bor"),
        ("pbpo-threshold", "skip", 3, r"expected both_bad or cannot_tell or none, got 3"),
        ("pbpo-threshold", "left", "both_bad", r"expected none for left, got 'both_bad'"),
        ("pbpo", "skip", "both_bad", r"pbpo does not learn from it, got 'both_bad'"),
    ],
)
def test_a_reason_that_means_nothing_is_refused(
    method: str, response: str, reason: str, message: str
) -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, method, 3)
    query = optimizer.ask()

    with pytest.raises(SkipReasonError, match=message):
        optimizer.tell(query, response, reason=reason)
    assert optimizer.ask() == query
    with pytest.raises(SkipReasonError, match=r"history\[0\]"):
        PreferenceOptimizer.replay(TRIANGLE, [(0, 1, response, reason)], method=method)
