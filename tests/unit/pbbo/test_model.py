"""The posterior over all candidates, and what answers of every kind do to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from app.pbbo import FitError, Preference, PreferenceOptimizer, Settings
from app.pbbo import model as model_module
from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.comparisons import tally
from app.pbbo.model import Posterior, belief_over
from app.pbbo.preferences import Response
from app.pbbo.prior import build, kernel
from app.pbbo.variational import Answers, fit

TRIANGLE: FloatArray = np.array([(i / 20, j / 20) for i in range(21) for j in range(i + 1)])
PAPER = Settings(length_scale=0.1, epsilon=0.01)
SHARPEST = Settings(length_scale=0.1, epsilon=0.0001)


def answers(*pairs: tuple[int, int]) -> list[Preference]:
    return [Preference(winner, loser, "answer", i) for i, (winner, loser) in enumerate(pairs)]


def random_answers(seed: int, count: int, n: int, noise: float = 0.0) -> list[Preference]:
    """Answers of an evaluator who likes the middle, with some noise."""
    rng = np.random.default_rng(seed)
    taste = -((np.arange(n) / n - 0.5) ** 2)
    pairs = []
    for _ in range(count):
        a, b = (int(i) for i in rng.choice(n, 2, replace=False))
        a_wins = taste[a] + noise * rng.normal() >= taste[b] + noise * rng.normal()
        pairs.append((a, b) if a_wins else (b, a))
    return answers(*pairs)


def belief(
    points: FloatArray, preferences: Sequence[Preference], settings: Settings = PAPER
) -> Posterior:
    return belief_over(Candidates.from_array(points, scale=True), preferences, settings)


def test_the_winner_rises_and_the_loser_falls_by_as_much() -> None:
    posterior = belief(TRIANGLE, answers((10, 200)))

    assert posterior.mean[10] > 0.3
    assert posterior.mean[200] == pytest.approx(-posterior.mean[10], abs=1e-9)
    assert int(np.argmax(posterior.mean)) == 10


def test_what_is_learned_fades_with_distance() -> None:
    line = np.linspace(0.0, 1.0, 41)[:, None]

    posterior = belief(line, answers((0, 40)))

    assert (np.diff(posterior.mean[:12]) < 0.0).all()
    assert posterior.mean[20] == pytest.approx(0.0, abs=1e-3)
    assert posterior.std[20] == pytest.approx(1.0, abs=1e-3)
    assert posterior.std[0] < 0.95


def test_the_posterior_is_that_of_regression_on_all_candidates_at_once() -> None:
    """The fit sees only the candidates in the data; here all of them, unwhitened, see it."""
    rng = np.random.default_rng(0)
    points = rng.uniform(size=(30, 2))
    preferences = random_answers(1, 25, 30, noise=0.2)
    prior = build(Candidates.from_array(points, scale=True).points, 0.1, 1.0)
    rows = np.zeros((25, 30))
    for i, p in enumerate(preferences):
        rows[i, p.winner], rows[i, p.loser] = 1.0, -1.0
    root = np.linalg.cholesky(prior.covariance)
    q = fit(Answers(rows @ root, np.ones(25), np.sqrt(2.0) * PAPER.epsilon))
    whole = root @ np.linalg.inv(q.root @ q.root.T) @ root.T

    posterior = belief(points, preferences)

    assert posterior.bound == pytest.approx(q.bound, abs=1e-5)
    assert posterior.mean == pytest.approx(root @ q.mean, abs=1e-4)
    assert posterior.std == pytest.approx(np.sqrt(np.diag(whole)), abs=1e-4)


@pytest.mark.parametrize("preferences", [0, 3, 40])
def test_sampled_functions_have_the_posterior_s_mean_and_covariance(preferences: int) -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(size=(15, 2))
    posterior = belief(points, random_answers(2, preferences, 15, noise=0.3))

    draws = posterior.draw(np.random.default_rng(5), 40_000)

    spread = (
        posterior.reach @ np.linalg.inv(posterior.q.root.T) if preferences else np.zeros((15, 1))
    )
    expected = (
        posterior.prior.block(np.arange(15))
        - posterior.reach @ posterior.reach.T
        + spread @ spread.T
    )
    assert draws.mean(axis=1) == pytest.approx(posterior.mean, abs=0.03)
    assert draws.std(axis=1) == pytest.approx(posterior.std, abs=0.02)
    assert np.cov(draws) == pytest.approx(expected, abs=0.03)


def test_swapping_the_sides_of_every_query_changes_nothing() -> None:
    history: list[tuple[int, int, Response]] = [
        (p.winner, p.loser, "left") for p in random_answers(3, 12, 231, noise=0.1)
    ]
    swapped = [(right, left, "right") for left, right, _ in history]
    history.append((7, 9, "skip"))
    swapped.append((9, 7, "skip"))

    one = PreferenceOptimizer.replay(TRIANGLE, history, seed=1)
    other = PreferenceOptimizer.replay(TRIANGLE, swapped, seed=1)

    assert one.posterior()[0].tolist() == other.posterior()[0].tolist()
    assert one.ask() == other.ask()


def test_the_order_of_the_answers_does_not_reach_the_arithmetic() -> None:
    preferences = random_answers(5, 30, 231, noise=0.1)

    forward, backward = belief(TRIANGLE, preferences), belief(TRIANGLE, preferences[::-1])

    assert forward.mean.tolist() == backward.mean.tolist()


def test_only_the_ratio_of_noise_and_signal_matters() -> None:
    preferences = random_answers(6, 20, 231)

    one = belief(TRIANGLE, preferences, Settings(epsilon=0.01))
    nine = belief(TRIANGLE, preferences, Settings(epsilon=0.03, signal_variance=9.0))

    assert nine.mean == pytest.approx(3.0 * one.mean, abs=1e-5)
    assert nine.std == pytest.approx(3.0 * one.std, abs=1e-5)


def test_repeating_an_answer_makes_it_firmer() -> None:
    noisy = Settings(epsilon=1.0)
    gaps = []
    for times in (1, 3, 10):
        posterior = belief(TRIANGLE, answers(*[(10, 200)] * times), noisy)
        gaps.append(posterior.mean[10] - posterior.mean[200])

    assert gaps[0] < gaps[1] < gaps[2]


def test_an_even_contradiction_leaves_both_equal() -> None:
    posterior = belief(TRIANGLE, answers((10, 200), (200, 10)), SHARPEST)

    assert posterior.mean[10] == pytest.approx(posterior.mean[200], abs=1e-6)


HARD = {
    "the same answer a thousand times": answers(*[(3, 50)] * 1000),
    "one against a thousand": answers(*[(3, 50)] * 999, (50, 3)),
    "the same pair both ways": answers(*[(3, 50), (50, 3)] * 10),
    "one candidate beats many others": answers(*[(0, i) for i in range(1, 100)]),
    "a circle": answers((3, 50), (50, 200), (200, 3)),
    "a circle of neighbours": answers(*[(3, 4), (4, 5), (5, 3)] * 5),
    "coin flips": random_answers(7, 90, 231, noise=100.0),
    "a perfect ranking": random_answers(8, 90, 231),
}


@pytest.mark.parametrize("epsilon", [1e-5, 1e-4, 0.01, 1.0, 100.0])
@pytest.mark.parametrize("name", HARD)
def test_answers_of_every_kind_and_noise_can_be_fitted(name: str, epsilon: float) -> None:
    posterior = belief(TRIANGLE, HARD[name], Settings(epsilon=epsilon))

    assert np.isfinite(posterior.mean).all()
    assert np.isfinite(posterior.std).all()
    assert (posterior.std > 0.0).all()
    assert (posterior.std <= 1.0 + 1e-6).all()
    assert np.isfinite(posterior.draw(np.random.default_rng(0), 2)).all()
    assert np.isfinite(posterior.bound)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    pairs=st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), min_size=1, max_size=25).map(
        lambda found: [(a, b) for a, b in found if a != b] or [(0, 1)]
    ),
    epsilon=st.sampled_from([1e-4, 0.01, 0.3, 3.0]),
    length_scale=st.sampled_from([1e-3, 0.1, 0.7, 50.0]),
)
def test_any_answers_over_a_few_candidates_can_be_fitted(
    pairs: list[tuple[int, int]], epsilon: float, length_scale: float
) -> None:
    grid = np.array([(i / 2, j / 2) for i in range(3) for j in range(3)])

    posterior = belief(grid, answers(*pairs), Settings(epsilon=epsilon, length_scale=length_scale))

    assert np.isfinite(posterior.mean).all()
    assert (posterior.std > 0.0).all()


def test_a_thousand_preferences_can_be_fitted() -> None:
    posterior = belief(TRIANGLE[:60], random_answers(9, 1000, 60, noise=0.05))

    middle = np.abs(np.arange(60) / 60 - 0.5)
    assert middle[int(np.argmax(posterior.mean))] < 0.15


def test_two_thousand_candidates_in_six_dimensions_can_be_handled() -> None:
    points = qmc.Halton(6, seed=0).random(2000)
    best = int(np.argmin(((points - 0.4) ** 2).sum(axis=1)))
    optimizer = PreferenceOptimizer(points, settings=Settings(length_scale=0.5))
    for _ in range(12):
        query = optimizer.ask()
        nearer = np.linalg.norm(points[[query.left, query.right]] - points[best], axis=1)
        optimizer.tell(query, "left" if nearer[0] <= nearer[1] else "right")

    assert optimizer.ask().acquisition == "thompson"


@pytest.mark.parametrize("gap", [1e-15, 1e-9, 1e-4])
@pytest.mark.parametrize("epsilon", [1e-4, 0.01])
def test_candidates_closer_than_the_jitter_can_be_compared(gap: float, epsilon: float) -> None:
    twins = np.concatenate([TRIANGLE, TRIANGLE[5:60] + np.array([gap, 0.0])])
    between_twins = [(i, 231 + i - 5) for i in range(5, 60, 5)]
    preferences = [*answers(*between_twins), *random_answers(10, 30, 231)]

    posterior = belief(twins, preferences, Settings(epsilon=epsilon))

    assert np.isfinite(posterior.mean).all()
    assert np.isfinite(posterior.std).all()


def test_the_diagonal_term_is_invisible_beside_the_kernel() -> None:
    prior = build(TRIANGLE, 0.1, 2.0)

    assert prior.covariance == pytest.approx(kernel(TRIANGLE, 0.1, 2.0), abs=1e-6)
    assert prior.root @ prior.root.T == pytest.approx(prior.covariance, abs=1e-10)


def test_equal_answers_are_counted_once() -> None:
    counted = tally(answers((4, 2), (7, 2), (4, 2), (2, 4)))

    assert counted.seen.tolist() == [2, 4, 7]
    rows = zip(counted.winner.tolist(), counted.loser.tolist(), counted.counts, strict=True)
    assert list(rows) == [(0, 1, 1.0), (1, 0, 2.0), (2, 0, 1.0)]


def test_an_optimiser_that_cannot_fit_asks_a_random_query_says_so_and_recovers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unfit(answers: Answers) -> None:
        raise FitError(f"fit: no luck with {len(answers.counts)} answers")

    optimizer = PreferenceOptimizer(TRIANGLE, seed=3)
    for _ in range(5):
        optimizer.tell(optimizer.ask(), "left")
    with monkeypatch.context() as broken:
        broken.setattr(model_module, "fit", unfit)
        query = optimizer.ask()
        winners = [p.winner for p in optimizer.preferences]

        assert (query.trial_type, query.acquisition) == ("random", "random-fallback")
        assert optimizer.best() in winners
        with pytest.raises(FitError, match="no luck"):
            optimizer.posterior()
    optimizer.tell(query, "left")

    assert optimizer.ask().acquisition == "thompson"
    assert np.isfinite(optimizer.posterior()[0]).all()


def test_linear_algebra_that_fails_counts_as_a_fit_that_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def singular(answers: Answers) -> None:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(model_module, "fit", singular)

    with pytest.raises(FitError, match=r"singular \(1 preferences\)"):
        belief(TRIANGLE, answers((0, 1)), replace(PAPER))
