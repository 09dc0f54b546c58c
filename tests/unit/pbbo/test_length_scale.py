"""The length scale chosen by the evidence lower bound."""

import numpy as np
import pytest

from app.pbbo import Preference, PreferenceOptimizer, Settings
from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.comparisons import Tally, tally
from app.pbbo.length_scale import best_length_scale, bound_and_slope

GRID: FloatArray = np.array([(i / 10, j / 10) for i in range(11) for j in range(11)])


def answers_to(taste: FloatArray, count: int, seed: int = 0) -> Tally:
    rng = np.random.default_rng(seed)
    preferences = []
    for _ in range(count):
        a, b = (int(i) for i in rng.choice(len(taste), 2, replace=False))
        winner, loser = (a, b) if taste[a] >= taste[b] else (b, a)
        preferences.append(Preference(winner, loser, "answer", 0))
    return tally(preferences)


@pytest.mark.parametrize("epsilon", [1e-4, 0.01, 0.3])
@pytest.mark.parametrize("length_scale", [0.05, 0.2, 0.9])
def test_the_slope_is_the_finite_difference_of_the_bound(
    epsilon: float, length_scale: float
) -> None:
    data = answers_to(np.sin(6.0 * GRID[:, 0]) + np.cos(5.0 * GRID[:, 1]), 20)
    settings = Settings(epsilon=epsilon)
    seen = GRID[data.seen]
    h = 1e-3

    _, slope = bound_and_slope(seen, data, settings, length_scale)
    above, _ = bound_and_slope(seen, data, settings, length_scale * np.exp(h))
    below, _ = bound_and_slope(seen, data, settings, length_scale * np.exp(-h))

    assert slope == pytest.approx((above - below) / (2.0 * h), rel=1e-3, abs=1e-3)


def test_the_length_scale_found_is_a_maximum_of_the_bound() -> None:
    data = answers_to(np.sin(6.0 * GRID[:, 0]) + np.cos(5.0 * GRID[:, 1]), 60)
    settings = Settings(epsilon=0.3)
    seen = GRID[data.seen]

    found = best_length_scale(GRID, data, settings)

    at, slope = bound_and_slope(seen, data, settings, found)
    assert slope == pytest.approx(0.0, abs=0.1)
    for factor in (0.8, 1.25):
        assert bound_and_slope(seen, data, settings, found * factor)[0] < at


def test_a_rougher_taste_gets_a_shorter_length_scale() -> None:
    settings = Settings(epsilon=0.3)
    smooth = answers_to(GRID[:, 0], 60)
    rough = answers_to(np.sin(25.0 * GRID[:, 0]) * np.sin(25.0 * GRID[:, 1]), 60)

    assert best_length_scale(GRID, rough, settings) < best_length_scale(GRID, smooth, settings)


def test_the_optimiser_chooses_its_kernel_when_the_settings_ask_for_it() -> None:
    history = []
    rng = np.random.default_rng(1)
    for _ in range(15):
        a, b = (int(i) for i in rng.choice(len(GRID), 2, replace=False))
        history.append((a, b, "left" if GRID[a, 0] >= GRID[b, 0] else "right"))
    chosen, fixed = (
        PreferenceOptimizer.replay(
            GRID, history, settings=Settings(epsilon=0.1, optimise_kernel=choice)
        )
        for choice in (True, False)
    )

    taste = Candidates.from_array(GRID, scale=True).points[:, 0]
    fits = [np.corrcoef(o.posterior()[0], taste)[0, 1] for o in (chosen, fixed)]
    assert fits[0] > fits[1]
    assert chosen.ask().acquisition == "thompson"
