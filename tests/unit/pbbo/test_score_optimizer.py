"""BO and RBO: optimisation of a measured score."""

import numpy as np
import pytest
from scipy.stats import norm, t

from app.pbbo import (
    SCORE_METHODS,
    SCORE_PRESETS,
    ScoreError,
    ScoreOptimizer,
    ScoreSettings,
    SettingsError,
    UnknownMethodError,
)
from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.prior import build
from app.pbbo.score_optimizer import regress

TRIANGLE: FloatArray = np.array([(i / 20, j / 20) for i in range(21) for j in range(i + 1)])
PEAK = np.array([0.7, 0.4])
LINE = np.linspace(0.0, 1.0, 11)[:, None]


def height(index: int) -> float:
    return -50.0 * float(np.linalg.norm(TRIANGLE[index] - PEAK))


@pytest.mark.parametrize("method", SCORE_METHODS)
def test_thirty_noisy_scores_find_the_top(method: str) -> None:
    rng = np.random.default_rng(0)
    settings = ScoreSettings(kappa=2.0, length_scale=0.3)
    optimizer = ScoreOptimizer(TRIANGLE, method, seed=1, settings=settings)
    for _ in range(30):
        index = optimizer.ask()
        optimizer.tell(index, height(index) + rng.normal())

    assert height(optimizer.best()) > -4.0


@pytest.mark.parametrize("method", SCORE_METHODS)
def test_a_replayed_optimiser_goes_on_where_the_first_one_is(method: str) -> None:
    optimizer = ScoreOptimizer(TRIANGLE, method, seed=4)
    history: list[tuple[int, float]] = []
    for _ in range(9):
        replayed = ScoreOptimizer.replay(TRIANGLE, history, method=method, seed=4)
        index = optimizer.ask()
        assert optimizer.ask() == replayed.ask() == index
        assert optimizer.best() == replayed.best()
        optimizer.tell(index, height(index))
        history.append((index, height(index)))


def test_the_first_five_are_different_random_candidates() -> None:
    optimizer = ScoreOptimizer(LINE, seed=2)
    asked = []
    for _ in range(5):
        asked.append(optimizer.ask())
        optimizer.tell(asked[-1], 0.0)

    assert len(set(asked)) == 5
    assert len({ScoreOptimizer(TRIANGLE, seed=seed).ask() for seed in range(30)}) > 20


def test_the_posterior_is_textbook_regression() -> None:
    rng = np.random.default_rng(3)
    settings = ScoreSettings(length_scale=0.3, noise=0.2)
    prior = build(LINE, 0.3, 1.0)
    seen = np.array([1, 4, 4, 9])
    scores = rng.normal(size=4)

    mean, std = regress(prior, seen, scores, settings, robust=False)

    system = np.linalg.inv(prior.covariance[np.ix_(seen, seen)] + 0.04 * np.eye(4))
    reach = prior.covariance[:, seen]
    assert mean == pytest.approx(reach @ system @ scores)
    variance = np.diag(prior.covariance - reach @ system @ reach.T)
    assert std == pytest.approx(np.sqrt(variance), abs=1e-6)


def test_the_robust_posterior_agrees_with_quadrature_over_one_score() -> None:
    """One candidate, three scores, one of them far off: the true posterior on a fine grid."""
    settings = ScoreSettings(noise=0.3, degrees_of_freedom=4.0)
    prior = build(np.array([[0.0], [1.0]]), 0.1, 1.0)
    scores = np.array([0.4, 0.6, 4.0])

    mean, _ = regress(prior, np.zeros(3, dtype=np.intp), scores, settings, robust=True)
    fooled, _ = regress(prior, np.zeros(3, dtype=np.intp), scores, settings, robust=False)

    f = np.linspace(-6.0, 6.0, 20_001)
    density = norm.pdf(f) * np.prod([t.pdf((y - f) / 0.3, 4.0) for y in scores], axis=0)
    expected = float(f @ density / density.sum())
    assert mean[0] == pytest.approx(expected, abs=0.05)
    assert fooled[0] > 1.4


def test_without_outliers_both_methods_agree() -> None:
    settings = ScoreSettings(length_scale=0.3, noise=0.1)
    prior = build(LINE, 0.3, 1.0)
    seen = np.arange(0, 11, 2)
    scores = np.sin(3.0 * LINE[seen, 0])

    plain, _ = regress(prior, seen, scores, settings, robust=False)
    robust, _ = regress(prior, seen, scores, settings, robust=True)

    assert robust == pytest.approx(plain, abs=0.05)


def test_a_larger_kappa_looks_further_from_what_is_known() -> None:
    history = [(i, -abs(i - 5.0)) for i in (3, 4, 5, 6, 7)]

    def asked(kappa: float) -> int:
        settings = ScoreSettings(kappa=kappa, length_scale=0.1)
        return ScoreOptimizer.replay(LINE, history, settings=settings).ask()

    assert asked(0.0) == 5
    assert asked(50.0) in (0, 1, 9, 10)


def test_ties_are_broken_by_the_seed_and_not_by_the_order_of_the_rows() -> None:
    settings = ScoreSettings(length_scale=0.001, random_queries=1)
    history = [(0, 1.0), (1, 0.0)]

    asked = {
        ScoreOptimizer.replay(TRIANGLE, history, seed=seed, settings=settings).ask()
        for seed in range(20)
    }

    assert len(asked) > 10


def test_the_posterior_is_in_the_score_s_own_units() -> None:
    history = [(i, 1000.0 + 10.0 * i) for i in range(11)]

    mean, std = ScoreOptimizer.replay(LINE, history).posterior()

    assert mean == pytest.approx([value for _, value in history], abs=3.0)
    assert (std > 0.0).all()
    assert (std < 10.0).all()


@pytest.mark.parametrize("method", SCORE_METHODS)
def test_equal_scores_do_no_harm(method: str) -> None:
    history = [(i, -69.7) for i in (0, 3, 3, 8, 10)]

    optimizer = ScoreOptimizer.replay(LINE, history, method=method)

    assert np.isfinite(optimizer.posterior()[0]).all()
    assert 0 <= optimizer.ask() < 11


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "3", None, True])
def test_a_score_that_is_no_number_is_refused(value: float) -> None:
    optimizer = ScoreOptimizer(LINE)

    with pytest.raises(ScoreError, match="expected a finite number"):
        optimizer.tell(optimizer.ask(), value)


def test_a_score_for_what_was_not_asked_is_refused() -> None:
    optimizer = ScoreOptimizer(LINE)
    with pytest.raises(ScoreError, match=r"ask\(\) comes first"):
        optimizer.tell(0, 1.0)
    index = optimizer.ask()

    with pytest.raises(ScoreError, match=f"waits \\({index}\\)"):
        optimizer.tell((index + 1) % 11, 1.0)
    with pytest.raises(ScoreError, match="expected a candidate from 0 to 10, got 11"):
        ScoreOptimizer.replay(LINE, [(11, 0.0)])


def test_unknown_methods_and_settings_are_refused() -> None:
    with pytest.raises(UnknownMethodError, match="expected one of bo, rbo, got 'ucb'"):
        ScoreOptimizer(LINE, "ucb")
    with pytest.raises(SettingsError, match="kappa"):
        ScoreSettings(kappa=-1.0)
    with pytest.raises(SettingsError, match="noise"):
        ScoreSettings(noise=0.0)


def test_the_paper_s_presets_hold_its_settings_in_the_ordinary_convention() -> None:
    held = {name: (s.kappa, round(s.length_scale**2, 10)) for name, s in SCORE_PRESETS.items()}

    assert held == {
        "paper-env1-bo": (2.0, 0.1),
        "paper-env1-rbo": (0.1, 0.01),
        "paper-env2-bo": (4.0, 0.0001),
        "paper-env2-rbo": (4.0, 0.001),
    }


def test_scaling_the_candidates_changes_nothing() -> None:
    history = [(2, 1.0), (7, 3.0), (9, 0.5)]

    one, other = (ScoreOptimizer.replay(c, history).posterior()[0] for c in (LINE, 40.0 * LINE))

    assert one == pytest.approx(other, abs=1e-9)
    assert len(Candidates.from_array(LINE, scale=True)) == 11
