"""GMRES against elimination."""

import numpy as np
import pytest

from app.pbbo.candidates import FloatArray
from app.pbbo.krylov import gmres


def test_it_solves_what_elimination_solves() -> None:
    rng = np.random.default_rng(0)
    system = np.eye(40) + 0.3 * rng.normal(size=(40, 40)) / np.sqrt(40)
    right = rng.normal(size=40)

    found = gmres(lambda x: np.asarray(system @ x), right, 1e-10, 40)

    assert found == pytest.approx(np.linalg.solve(system, right), abs=1e-8)


def test_it_stops_once_it_is_close_enough() -> None:
    rng = np.random.default_rng(1)
    system = np.eye(40) + 0.3 * rng.normal(size=(40, 40)) / np.sqrt(40)
    right = rng.normal(size=40)
    calls = []

    def apply(x: FloatArray) -> FloatArray:
        calls.append(1)
        return np.asarray(system @ x)

    found = gmres(apply, right, 0.05, 40)

    assert len(calls) < 10
    assert np.linalg.norm(system @ found - right) <= 0.05 * np.linalg.norm(right) + 1e-12


def test_nothing_is_the_answer_to_nothing() -> None:
    assert gmres(lambda x: x, np.zeros(3), 0.1, 5).tolist() == [0.0, 0.0, 0.0]


def test_it_ends_where_the_right_side_is_reached_in_one_step() -> None:
    assert gmres(lambda x: 2.0 * x, np.ones(4), 1e-12, 10) == pytest.approx(np.full(4, 0.5))
