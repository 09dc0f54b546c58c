"""Bradley-Terry with random effects of candidates and of people, by Laplace's approximation.

The log odds that a candidate is chosen over another are the difference of their abilities, plus
that of the person's own deviations from them; abilities and deviations are independent and normal
(the random item and subject effects of Turner and Firth, BradleyTerry2, J. Stat. Software 48(9),
2012). Their variances maximise the approximate evidence over a grid. Candidates are known by name
alone, not by their parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_expit

FloatArray = NDArray[np.float64]
#: Who chose, the number of the candidate chosen, and of the other.
Choice = tuple[int, int, int]

#: Standard deviations of abilities and of people's deviations that are compared.
ABILITY_SPREADS: Final = (0.5, 1.0, 2.0, 4.0)
PERSON_SPREADS: Final = (0.0, 0.5, 1.0, 2.0)
STEPS: Final = 50
TOLERANCE: Final = 1e-8


def abilities(choices: Sequence[Choice], n: int) -> FloatArray:
    """The mean ability of each of n candidates; (n,)."""
    people = np.array([who for who, _, _ in choices])
    design = np.zeros((len(choices), n))
    rows = np.arange(len(choices))
    design[rows, [winner for _, winner, _ in choices]] += 1.0
    design[rows, [loser for _, _, loser in choices]] -= 1.0
    alike = design @ design.T
    of_one_person = alike * (people[:, None] == people[None, :])
    best, found = -np.inf, np.zeros(n)
    for ability in ABILITY_SPREADS:
        for person in PERSON_SPREADS:
            evidence, slope = laplace(ability**2 * alike + person**2 * of_one_person)
            if evidence > best:
                best, found = evidence, ability**2 * design.T @ slope
    return found


def laplace(covariance: FloatArray) -> tuple[float, FloatArray]:
    """The log evidence of choices (m,), and the slope of their log likelihood at the mode.

    covariance: (m, m), of what each choice sees. Newton's steps of Rasmussen and Williams,
    Gaussian Processes for Machine Learning, algorithm 3.1.
    """
    m = len(covariance)
    at, weights = np.zeros(m), np.zeros(m)
    for _ in range(STEPS):
        slope = expit(-at)
        curvature = slope * (1.0 - slope)
        root = np.sqrt(curvature)
        system = np.eye(m) + root[:, None] * covariance * root[None, :]
        aim = curvature * at + slope
        weights = aim - root * np.linalg.solve(system, root * (covariance @ aim))
        after = covariance @ weights
        moved = float(np.max(np.abs(after - at)))
        at = after
        if moved < TOLERANCE:
            break
    evidence = float(log_expit(at).sum() - 0.5 * weights @ at - 0.5 * np.linalg.slogdet(system)[1])
    return evidence, weights
