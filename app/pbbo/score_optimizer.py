"""Bayesian optimisation of a score that can be measured: the paper's BO and RBO (Section VII-A-3).

Both put a Gaussian process with an RBF kernel on the score and ask for the candidate with the
largest upper confidence bound, mean + kappa std. BO takes the noise of a score as Gaussian. RBO
tolerates outliers; the paper does not give the form of its robust model, ours is a Student-t
likelihood, as a Gaussian whose precision is drawn per observation from a gamma distribution, fitted
by mean-field variational inference: q(f) and the precisions in turn, each in closed form.

Scores are standardised by the mean and standard deviation of those told so far, so that kappa and
the noise mean the same for any score.
"""

from collections.abc import Iterable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from .candidates import Candidates, FloatArray, IndexArray
from .errors import FitError, ScoreError, SettingsError, UnknownMethodError
from .one_thread import one_thread
from .randomness import Purpose, checked_seed, generator
from .settings import ScoreSettings, ordinary_length_scale

if TYPE_CHECKING:
    from .prior import Prior

SCORE_METHODS: Final = ("bo", "rbo")

# Upper bounds this close, in standardised scores, differ by rounding alone.
TIE: Final = 1e-9
# Mean-field updates stop when no observation's precision changes by more than this share.
PRECISION_TOLERANCE: Final = 1e-6
MOST_UPDATES: Final = 500

# Section VII-A-3, the kernel read as exp(-d^2 / (2 l)) like PBPO's.
SCORE_PRESETS: Final[Mapping[str, ScoreSettings]] = MappingProxyType(
    {
        "paper-env1-bo": ScoreSettings(kappa=2.0, length_scale=ordinary_length_scale(0.1)),
        "paper-env1-rbo": ScoreSettings(kappa=0.1, length_scale=ordinary_length_scale(0.01)),
        "paper-env2-bo": ScoreSettings(kappa=4.0, length_scale=ordinary_length_scale(0.0001)),
        "paper-env2-rbo": ScoreSettings(kappa=4.0, length_scale=ordinary_length_scale(0.001)),
    }
)


class ScoreOptimizer:
    """Finds the candidate with the largest score from noisy measurements, one at a time.

    candidates: (n, d), finite, at least two different rows.
    """

    def __init__(
        self,
        candidates: Any,
        method: str = "bo",
        seed: int = 0,
        settings: ScoreSettings | None = None,
    ) -> None:
        if method not in SCORE_METHODS:
            raise UnknownMethodError(
                f"method: expected one of {', '.join(SCORE_METHODS)}, got {method!r}"
            )
        self._robust = method == "rbo"
        self._seed = checked_seed(seed)
        self._settings = ScoreSettings() if settings is None else settings
        if not isinstance(self._settings, ScoreSettings):
            raise SettingsError(f"settings: expected a ScoreSettings value, got {settings!r}")
        self._candidates = Candidates.from_array(candidates, scale=self._settings.scale_candidates)
        self._indices: list[int] = []
        self._values: list[float] = []
        self._pending: int | None = None
        self._belief: tuple[FloatArray, FloatArray] | None = None

    @classmethod
    def replay(
        cls,
        candidates: Any,
        history: Iterable[tuple[int, float]],
        *,
        method: str = "bo",
        seed: int = 0,
        settings: ScoreSettings | None = None,
    ) -> Self:
        """The optimiser after exactly these (index, value), oldest first."""
        optimizer = cls(candidates, method, seed, settings)
        for index, value in history:
            optimizer._record(index, value)
        return optimizer

    def ask(self) -> int:
        """The candidate to measure next; the same one until `tell`."""
        if self._pending is None:
            self._pending = self._propose()
        return self._pending

    def tell(self, index: int, value: float) -> None:
        """Take the score measured at the candidate that `ask` gave."""
        if self._pending is None or index != self._pending:
            waiting = "none, ask() comes first" if self._pending is None else str(self._pending)
            raise ScoreError(f"tell: expected the candidate that waits ({waiting}), got {index!r}")
        self._record(index, value)

    def best(self) -> int:
        """The candidate with the largest posterior mean; one from the seed before any score."""
        if not self._values:
            rng = generator(self._seed, Purpose.UNINFORMED, 0)
            return int(rng.integers(len(self._candidates)))
        mean, _ = self._standardised()
        return int(np.argmax(mean >= mean.max() - TIE))

    def posterior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the score at every candidate, in its own units; each (n,).

        Before any score: zero mean and the prior's standard deviation.
        """
        mean, std = self._standardised()
        centre, spread = self._scale()
        return centre + spread * mean, spread * std

    def _record(self, index: int, value: float) -> None:
        n = len(self._candidates)
        if (
            isinstance(index, bool)
            or not isinstance(index, (int, np.integer))
            or not 0 <= index < n
        ):
            raise ScoreError(f"score: expected a candidate from 0 to {n - 1}, got {index!r}")
        number = isinstance(value, (int, float, np.integer, np.floating))
        if isinstance(value, bool) or not number or not isfinite(value):
            raise ScoreError(
                f"score: expected a finite number for candidate {index}, got {value!r}"
            )
        self._indices.append(int(index))
        self._values.append(float(value))
        self._pending = None
        self._belief = None

    def _propose(self) -> int:
        rng = generator(self._seed, Purpose.SCORE, len(self._values))
        n = len(self._candidates)
        if len(self._values) < self._settings.random_queries:
            fresh = np.setdiff1d(np.arange(n), self._indices)
            return int(rng.choice(fresh if len(fresh) else n))
        mean, std = self._standardised()
        bound = mean + self._settings.kappa * std
        # Candidates far from all scores tie. The first would make the order of the rows matter.
        return int(rng.choice(np.flatnonzero(bound >= bound.max() - TIE)))

    def _scale(self) -> tuple[float, float]:
        """Centre and spread of the scores so far."""
        if not self._values:
            return 0.0, 1.0
        values = np.array(self._values)
        spread = float(values.std())
        # Equal scores have no spread; rounding may leave them a trace of one.
        if spread <= 1e-12 * float(np.abs(values).max()):
            spread = 1.0
        return float(values.mean()), spread

    def _standardised(self) -> tuple[FloatArray, FloatArray]:
        """Posterior mean and standard deviation of the standardised score; each (n,)."""
        if self._belief is None:
            # SciPy takes a third of a second to import; see PreferenceOptimizer.
            from .prior import prior_over  # noqa: PLC0415

            prior = prior_over(
                self._candidates, self._settings.length_scale, self._settings.signal_variance
            )
            centre, spread = self._scale()
            with one_thread():
                self._belief = regress(
                    prior,
                    np.array(self._indices, dtype=np.intp),
                    (np.array(self._values) - centre) / spread,
                    self._settings,
                    robust=self._robust,
                )
        return self._belief


def regress(
    prior: "Prior",
    seen: IndexArray,
    scores: FloatArray,
    settings: ScoreSettings,
    *,
    robust: bool,
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and standard deviation over all candidates, (n,) each, given scores (m,)."""
    gram = prior.covariance[np.ix_(seen, seen)]
    variance = settings.noise**2
    precision = np.full(len(seen), 1.0 / variance)
    if robust:
        freedom = settings.degrees_of_freedom
        for _ in range(MOST_UPDATES):
            mean, spread = at_scores(gram, scores, precision)
            expected_square = (scores - mean) ** 2 + spread
            updated = (freedom + 1.0) / (freedom * variance + expected_square)
            change = float(np.abs(updated / precision - 1.0).max(initial=0.0))
            precision = updated
            if change < PRECISION_TOLERANCE:
                break
    system = gram + np.diag(1.0 / precision)
    reach = prior.covariance[:, seen]  # (n, m)
    solved = np.linalg.solve(system, np.column_stack([scores, reach.T]))  # (m, 1 + n)
    mean = reach @ solved[:, 0]
    own = np.diagonal(prior.covariance)
    left = own - np.einsum("ij,ji->i", reach, solved[:, 1:])
    if not (np.isfinite(mean).all() and np.isfinite(left).all()):
        raise FitError(f"score model: the posterior of {len(seen)} scores is not finite")
    return mean, np.sqrt(np.maximum(left, 1e-12 * own))


def at_scores(
    gram: FloatArray, scores: FloatArray, precision: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and variance of the function where scores were taken; each (m,)."""
    gain = np.linalg.solve(gram + np.diag(1.0 / precision), gram).T  # gram (gram + noise)^-1
    return gain @ scores, np.maximum(np.diagonal(gram - gain @ gram), 0.0)
