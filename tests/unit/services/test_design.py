"""What simulated sessions tell of a design."""

from __future__ import annotations

import numpy as np
import pytest

from app.services.studies.simulation_results import _enough


@pytest.mark.parametrize(
    ("regret", "enough"),
    [
        ([20.0, 10.0, 5.0, 5.0], 3),
        # It rises again by noise: nothing that follows is better.
        ([30.0, 20.0, 11.5, 12.5, 13.2], 3),
        ([3.0], 1),
        ([5.0, 5.0, 5.0], 1),
        ([5.0, 6.0, 7.0], 1),
        ([10.0, 9.0, 0.0], 3),
    ],
)
def test_a_trial_is_long_enough_once_what_follows_hardly_gains(
    regret: list[float], enough: int
) -> None:
    assert _enough(np.array(regret)) == enough
