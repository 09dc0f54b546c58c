"""The variational fit against answers found without it: brute force, sampling, other optimisers."""

from math import lgamma

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import log_ndtr

from app.pbbo import variational
from app.pbbo.candidates import FloatArray
from app.pbbo.errors import FitError
from app.pbbo.probit import expectations
from app.pbbo.variational import Answers, Gaussian, evaluate, fit, growth_of, widths


def problem(seed: int, answers: int, variables: int, scale: float) -> Answers:
    """Random functionals of a few whitened variables, some answered more than once."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(answers, variables))
    return Answers(features, rng.integers(1, 4, answers).astype(float), scale)


def log_joint(answers: Answers, z: FloatArray) -> FloatArray:
    """log p(answers | z) + log p(z); z: (k, r)."""
    log_prior = -0.5 * (z**2).sum(axis=1) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)
    seen = z @ answers.features.T / answers.scale
    return np.asarray(log_prior + log_ndtr(seen) @ answers.counts)


def brute_force(answers: Answers) -> tuple[float, FloatArray, FloatArray]:
    """Log evidence, mean and covariance of the true posterior over two variables, on a grid."""
    axis = np.linspace(-6.5, 6.5, 401)
    step = float(axis[1] - axis[0])
    z = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_weight = log_joint(answers, z)
    peak = log_weight.max()
    weight = np.exp(log_weight - peak)
    evidence = float(peak + np.log(weight.sum() * step**2))
    weight /= weight.sum()
    mean = weight @ z
    return evidence, mean, (z - mean).T * weight @ (z - mean)


def covariance(q: Gaussian) -> FloatArray:
    return np.asarray(np.linalg.inv(q.root @ q.root.T))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    answers=st.integers(1, 6),
    scale=st.sampled_from([0.1, 0.5, 1.5, 5.0]),
)
def test_the_bound_is_never_above_the_log_evidence(seed: int, answers: int, scale: float) -> None:
    tiny = problem(seed, answers, 2, scale)

    evidence, _, _ = brute_force(tiny)

    # The grid's own error, where the likelihood is steep.
    assert fit(tiny).bound <= evidence + 1e-4 / scale


@pytest.mark.parametrize("candidates", [2, 3, 5, 8])
@pytest.mark.parametrize("scale", [1e-6, 1.4e-4, 0.01])
def test_the_bound_of_a_full_ranking_is_below_its_chance(candidates: int, scale: float) -> None:
    """Of independent candidates every order is as likely as any other, and without noise the
    evidence of the order is one in as many as there are; noise can only lower it."""
    above, below = np.triu_indices(candidates, 1)
    features = np.eye(candidates)[above] - np.eye(candidates)[below]

    q = fit(Answers(features, np.ones(len(features)), scale))

    assert q.bound <= -lgamma(candidates + 1) + 1e-9
    assert (np.diff(q.mean) < 0.0).all()


@pytest.mark.parametrize("seed", range(6))
def test_a_loud_evaluator_s_posterior_is_the_true_one(seed: int) -> None:
    tiny = problem(seed, 4, 2, scale=3.0)

    evidence, mean, cov = brute_force(tiny)
    q = fit(tiny)

    std = np.sqrt(np.diag(cov))
    assert q.bound == pytest.approx(evidence, abs=0.01)
    assert (q.mean - mean) / std == pytest.approx(np.zeros(2), abs=0.01)
    assert covariance(q) == pytest.approx(cov, abs=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_a_steadier_evaluator_s_posterior_is_close_to_the_true_one(seed: int) -> None:
    """A Gaussian cannot follow a cut-off posterior; its mean stays near, its width falls short."""
    tiny = problem(seed, 4, 2, scale=0.5)

    evidence, mean, cov = brute_force(tiny)
    q = fit(tiny)

    std = np.sqrt(np.diag(cov))
    assert evidence - 0.4 < q.bound <= evidence
    assert (q.mean - mean) / std == pytest.approx(np.zeros(2), abs=0.15)
    ratio = np.sqrt(np.diag(covariance(q))) / std
    assert ((ratio > 0.7) & (ratio < 1.01)).all()


def test_an_answer_and_its_opposite_balance() -> None:
    both = Answers(np.array([[1.0], [-1.0]]), np.ones(2), 0.4)

    q = fit(both)

    assert q.mean == pytest.approx([0.0], abs=1e-9)
    assert covariance(q)[0, 0] < 0.2


def test_means_and_widths_agree_with_a_long_markov_chain() -> None:
    """Twelve variables, twenty answers: elliptical slice sampling, which knows no bound."""
    answers = problem(1, 20, 12, scale=2.0)
    rng = np.random.default_rng(2)
    z = np.zeros(12)

    def log_likelihood(at: FloatArray) -> float:
        return float(log_ndtr(answers.features @ at / answers.scale) @ answers.counts)

    kept = []
    for step in range(22_000):
        other = rng.normal(size=12)
        level = log_likelihood(z) + np.log(rng.uniform())
        angle = rng.uniform(0.0, 2.0 * np.pi)
        low, high = angle - 2.0 * np.pi, angle
        while log_likelihood(tried := z * np.cos(angle) + other * np.sin(angle)) <= level:
            low, high = (angle, high) if angle < 0.0 else (low, angle)
            angle = rng.uniform(low, high)
        z = tried
        if step >= 2_000:
            kept.append(z)
    chain = np.array(kept)

    q = fit(answers)

    assert q.mean == pytest.approx(chain.mean(axis=0), abs=0.07)
    assert np.sqrt(np.diag(covariance(q))) == pytest.approx(chain.std(axis=0), abs=0.06)


@pytest.mark.parametrize("scale", [1.4e-4, 0.014, 0.14, 1.4])
def test_another_optimiser_over_every_gaussian_finds_no_better_one(scale: float) -> None:
    """Nelder-Mead over mean and Cholesky factor: no natural parameters, no derivatives."""
    tiny = problem(7, 3, 2, scale)
    rows, columns = np.tril_indices(2)

    def loss(theta: FloatArray) -> float:
        root = np.zeros((2, 2))
        root[rows, columns] = theta[2:]
        root[[0, 1], [0, 1]] = np.exp(theta[[2, 4]])
        spread = tiny.features @ root
        e = expectations(tiny.features @ theta[:2] / scale, np.linalg.norm(spread, axis=1) / scale)
        prior = 0.5 * ((root**2).sum() + (theta[:2] ** 2).sum()) - 1.0 - theta[2] - theta[4]
        return float(prior - tiny.counts @ e.value)

    q = fit(tiny)
    best = np.inf
    start = np.zeros(5)
    for _ in range(12):
        found = minimize(
            loss, start, method="Nelder-Mead", options={"maxiter": 4000, "fatol": 1e-10}
        )
        best, start = min(best, float(found.fun)), found.x

    assert -q.bound <= best + 1e-6
    assert -q.bound == pytest.approx(best, abs=2e-2)


@pytest.mark.parametrize("scale", [1.4e-4, 0.014, 0.14, 1.4])
@pytest.mark.parametrize("seed", range(3))
def test_any_move_of_mean_or_sites_lowers_the_bound(scale: float, seed: int) -> None:
    answers = problem(seed, 12, 8, scale)
    q = fit(answers)
    rng = np.random.default_rng(seed)

    for _ in range(20):
        # In posterior deviations and in logarithms, so that the move is felt but small.
        shift = np.linalg.solve(q.root.T, 0.01 * rng.normal(size=8))
        factor = np.exp(0.01 * rng.normal(size=12))
        moved = evaluate(answers, q.mean + shift, q.sites * factor)
        assert moved is not None
        assert moved.q.bound < q.bound


def test_the_bound_s_gradient_is_its_finite_difference() -> None:
    answers = problem(3, 6, 4, 0.3)
    mean = np.array([0.4, -0.2, 0.1, 0.3])
    sites = np.array([0.5, 1.0, 2.0, 0.1, 4.0, 0.7])
    state = evaluate(answers, mean, sites)
    assert state is not None

    def bound(mean: FloatArray, sites: FloatArray) -> float:
        at = evaluate(answers, mean, sites)
        assert at is not None
        return at.q.bound

    by_mean = answers.features.T @ state.slope - mean
    shared = answers.features @ np.linalg.solve(state.q.root @ state.q.root.T, answers.features.T)
    by_sites = 0.5 * shared**2 @ (state.curvature - sites)
    h = 1e-5
    for i, unit in enumerate(np.eye(4)):
        difference = (bound(mean + h * unit, sites) - bound(mean - h * unit, sites)) / (2.0 * h)
        assert by_mean[i] == pytest.approx(difference, rel=1e-5, abs=1e-6)
    for i, unit in enumerate(np.eye(6)):
        difference = (bound(mean, sites + h * unit) - bound(mean, sites - h * unit)) / (2.0 * h)
        assert by_sites[i] == pytest.approx(difference, rel=1e-4, abs=1e-6)


def test_counts_are_repeated_answers() -> None:
    once = problem(5, 4, 3, 0.2)
    repeated = Answers(
        np.repeat(once.features, once.counts.astype(int), axis=0),
        np.ones(int(once.counts.sum())),
        once.scale,
    )

    assert fit(repeated).bound == pytest.approx(fit(once).bound, abs=1e-6)
    assert fit(repeated).mean == pytest.approx(fit(once).mean, abs=1e-5)


@pytest.mark.parametrize("scale", [1.4e-4, 0.014, 0.14, 1.4])
@pytest.mark.parametrize("very_many", [10**9, 0])
def test_many_answers_are_fitted_iteratively_to_the_same_posterior(
    scale: float, very_many: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = problem(11, 60, 10, scale)
    by_elimination = fit(answers)

    monkeypatch.setattr(variational, "FEW", 0)
    monkeypatch.setattr(variational, "VERY_MANY", very_many)
    iteratively = fit(answers)

    assert iteratively.bound == pytest.approx(by_elimination.bound, abs=1e-5)
    shift = by_elimination.root.T @ (iteratively.mean - by_elimination.mean)
    assert shift == pytest.approx(np.zeros(10), abs=1e-3)


def test_a_fit_that_stalls_is_tried_again_more_slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = problem(2, 12, 8, 0.014)
    expected = fit(answers)
    ratios = []
    patiently = variational.fit_in_stages

    def stalling(answers: Answers, prior_variance: FloatArray, ratio: float) -> Gaussian:
        ratios.append(ratio)
        if len(ratios) == 1:
            raise FitError("fit: stalled")
        return patiently(answers, prior_variance, ratio)

    monkeypatch.setattr(variational, "fit_in_stages", stalling)

    assert fit(answers).bound == pytest.approx(expected.bound, abs=1e-6)
    assert ratios[1] < ratios[0]


def test_the_root_is_that_of_the_precision_and_triangular() -> None:
    answers = problem(4, 9, 5, 0.3)
    sites = np.linspace(0.0, 3.0, 9)

    known = widths(answers.features, sites)

    assert known is not None
    precision = np.eye(5) + (answers.features.T * sites) @ answers.features
    assert known.root @ known.root.T == pytest.approx(precision, rel=1e-12)
    assert not np.triu(known.root, 1).any()
    seen = np.einsum("ij,jk,ik->i", answers.features, np.linalg.inv(precision), answers.features)
    assert known.variance == pytest.approx(seen, rel=1e-10)


def test_a_site_is_foreseen_to_grow_faster_the_nearer_it_is_to_its_largest() -> None:
    share = np.array([0.0, 1e-3, 0.02, 0.15, 0.4, 0.9, 1.0])

    growth = growth_of(share, np.zeros(7))

    assert (np.diff(growth) >= 0.0).all()
    assert growth[0] >= 0.0
    assert growth[-1] == variational.FASTEST_GROWTH
    # What grew with the square once goes on so, whatever its share.
    assert (growth_of(share, np.full(7, 2.0)) == variational.FASTEST_GROWTH).all()
