"""Ask and tell: the only door to the preference optimiser.

A proposal is a pure function of (candidates, method, settings, history, seed, index). Nothing is
carried from one model fit to the next, so an optimiser replayed from stored responses proposes what
the one that never stopped would have, at the cost of one fit.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from .acquisition import random_pair, thompson_pair
from .box import Box
from .box_optimizer import BoxOptimizer
from .candidates import Candidates, FloatArray
from .errors import (
    FitError,
    HistoryError,
    NoPosteriorError,
    QueryNotAskedError,
    SettingsError,
    SkipNotOfferedError,
    SkipReasonError,
    UnknownResponseError,
)
from .farthest_point import farthest_points
from .knockout import challenger
from .methods import method_named
from .one_thread import one_thread
from .preferences import (
    Preference,
    Query,
    Response,
    SkipReason,
    TrialType,
    checked_response,
    checked_share,
)
from .quasi_random import quasi_random_candidates
from .randomness import Purpose, checked_seed, generator
from .settings import Settings
from .skip_synthesis import Learned

if TYPE_CHECKING:
    from .model import AnyPrior, Posterior
    from .model_averaging import Average
    from .sureness import Landscapes

# Means this close, in prior standard deviations, differ by rounding alone.
TIE = 1e-9


class PreferenceOptimizer:
    """Finds the candidate an evaluator likes best from choices between two.

    candidates: (n, d), finite, at least two different rows. For a `Box` in its place the result is
    a `BoxOptimizer`, which takes the same arguments.
    """

    def __new__(cls, candidates: Any, *args: Any, **kwargs: Any) -> Any:
        """A `BoxOptimizer` where candidates are a box."""
        return (
            BoxOptimizer(candidates, *args, **kwargs)
            if isinstance(candidates, Box)
            else super().__new__(cls)
        )

    def __init__(
        self,
        candidates: Any,
        method: str = "pbpo",
        seed: int = 0,
        settings: Settings | None = None,
    ) -> None:
        self._method_name = method
        self._method = method_named(method)
        self._seed = checked_seed(seed)
        self._settings = Settings() if settings is None else settings
        if not isinstance(self._settings, Settings):
            raise SettingsError(f"settings: expected a Settings value, got {settings!r}")
        self._candidates = Candidates.from_array(candidates, scale=self._settings.scale_candidates)
        self._learned = Learned(seed=self._seed, synthesise=self._method.synthesis)
        self._told = 0
        self._last: frozenset[int] = frozenset()
        self._pending: Query | None = None
        self._belief: Posterior | Average | FitError | None = None
        # Depends on the candidates and the settings alone: kept between fits, never learned.
        self._prior: AnyPrior | None = None

    @classmethod
    def replay(
        cls,
        candidates: Any,
        history: Iterable[tuple[int, int, str] | tuple[int, int, str, str | None]],
        *,
        method: str = "pbpo",
        seed: int = 0,
        settings: Settings | None = None,
    ) -> Self:
        """The optimiser after exactly these (left, right, response), oldest first.

        An entry may have the reason of a skip as a fourth part. The queries are taken as stored,
        whether or not this version would have asked them.
        """
        optimizer: Self = cls(candidates, method, seed, settings)
        for place, entry in enumerate(history):
            optimizer._record(*optimizer._checked_entry(place, entry))
        return optimizer

    def ask(self) -> Query:
        """The query that waits for a response; the same one until `tell`."""
        if self._pending is None:
            self._pending = self._propose()
        return self._pending

    def tell(self, query: Query, response: str, reason: str | None = None) -> None:
        """Take the response to the query that `ask` gave.

        reason: why a query was skipped, "both_bad" or "cannot_tell", for a method that learns from
        it. Without one a skip means what the setting `threshold_skip_means` says.
        """
        if self._pending is None or query != self._pending:
            waiting = "none, ask() comes first" if self._pending is None else repr(self._pending)
            raise QueryNotAskedError(
                f"tell: expected the query that waits ({waiting}), got {query!r}"
            )
        checked = checked_response(response)
        self._record(query.left, query.right, *self._method.understood(checked, reason))

    def best(self) -> int:
        """The acquired candidate: the largest posterior mean, or knockout's last winner.

        Of equal means the first row. While nothing has been learned every candidate is as good as
        any other, and one drawn from the seed is named. Where the model cannot be fitted, the
        candidate that won most often, counted against its losses.
        """
        n = len(self._candidates)
        if not self._method.model:
            winner = self._learned.last_choice
            return self._uninformed() if winner is None else winner
        if not self._learned.preferences and not (self._method.threshold and self._learned.skips):
            return self._uninformed()
        try:
            mean, _ = self.posterior()
        except FitError:
            wins = np.zeros(n)
            for preference in self._learned.preferences:
                wins[preference.winner] += 1.0
                wins[preference.loser] -= 1.0
            return int(np.argmax(wins))
        margin = TIE * float(np.sqrt(self._settings.signal_variance))
        return int(np.argmax(mean >= mean.max() - margin))

    def posterior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the latent function at every candidate; each (n,).

        `NoPosteriorError` for a method without a model, `FitError` where it cannot be fitted.
        """
        if not self._method.model:
            raise NoPosteriorError(f"posterior: {self._method_name} keeps no model of the answers")
        with one_thread():
            belief = self._believe()
        return belief.mean.copy(), belief.std.copy()

    def sureness(self, within: float) -> float:
        """Probability that no candidate is better than `best()` by more than `within`.

        within: as a share, from 0 to 1, of the range of f over the candidates. Errors as for
        `posterior`, and `SurenessError`.
        """
        share = checked_share("within", within)
        return self._landscapes().sureness(self.best(), share)

    def may_be_best(self, probability: float = 0.95) -> tuple[int, ...]:
        """The fewest candidates that hold the best one with this probability, likeliest first."""
        return self._landscapes().may_be_best(checked_share("probability", probability))

    def _landscapes(self) -> "Landscapes":
        """Functions drawn from the belief; the same for the same history and seed."""
        from .sureness import Landscapes  # noqa: PLC0415

        if not self._method.model:
            raise NoPosteriorError(f"sureness: {self._method_name} keeps no model of the answers")
        with one_thread():
            rng = generator(self._seed, Purpose.SURENESS, self._told)
            return Landscapes(self._believe(), len(self._candidates), self.best(), rng)

    @property
    def preferences(self) -> tuple[Preference, ...]:
        """What has been learned so far, in the order in which it was learned."""
        return self._learned.preferences

    @property
    def responses(self) -> int:
        """How many responses were taken, skips included: the index of the next query."""
        return self._told

    @property
    def settings(self) -> Settings:
        """The settings in force."""
        return self._settings

    def _record(self, left: int, right: int, response: Response, reason: SkipReason | None) -> None:
        meant = self._settings.threshold_skip_means if reason is None else reason
        self._learned.record(self._told, left, right, response, meant)
        self._told += 1
        self._last = frozenset((left, right))
        self._pending = None
        self._belief = None

    def _checked_entry(
        self, place: int, entry: object
    ) -> tuple[int, int, Response, SkipReason | None]:
        """One entry of a stored history, or a named error with its place."""
        n = len(self._candidates)
        if not isinstance(entry, (tuple, list)) or len(entry) not in (3, 4):
            raise HistoryError(
                f"history[{place}]: expected (left, right, response), or with a reason behind, "
                f"got {entry!r}"
            )
        left, right, response = entry[:3]
        for side in (left, right):
            whole = isinstance(side, (int, np.integer)) and not isinstance(side, bool)
            if not whole or not 0 <= side < n:
                raise HistoryError(
                    f"history[{place}]: expected candidates from 0 to {n - 1}, got {side!r}"
                )
        if left == right:
            raise HistoryError(
                f"history[{place}]: expected two different candidates, got {left} on both sides"
            )
        try:
            reason = entry[3] if len(entry) == 4 else None
            checked = self._method.understood(checked_response(response), reason)
        except (SkipNotOfferedError, SkipReasonError, UnknownResponseError) as error:
            raise type(error)(f"history[{place}]: {error}") from error
        return int(left), int(right), *checked

    def _propose(self) -> Query:
        index = self._told
        trial_type, acquisition, pair = self._choose(index)
        if generator(self._seed, Purpose.SIDES, index).integers(2):
            pair = pair[::-1]
        return Query(index, pair[0], pair[1], trial_type, acquisition, self._seed)

    def _choose(self, index: int) -> tuple[TrialType, str, tuple[int, int]]:
        if not self._method.model:
            winner = self._learned.last_choice
            if winner is None:
                return "random", "random", self._random_pair(index)
            rng = generator(self._seed, Purpose.KNOCKOUT, index)
            opponent = challenger(rng, len(self._candidates), winner, self._last)
            return "model", "knockout", (winner, opponent)
        if self._method.threshold and self._settings.threshold_covering:
            covering_pair = self._covering_pair(index)
            if covering_pair is not None:
                return "random", "covering", covering_pair
        elif self._learned.answers < self._settings.random_queries:
            return "random", "random", self._random_pair(index)
        try:
            with one_thread():
                return "model", *self._model_pair(index)
        except FitError:
            # The evaluator goes on; the record says that this query was not the model's.
            return "random", "random-fallback", self._random_pair(index)

    def _model_pair(self, index: int) -> tuple[str, tuple[int, int]]:
        """The acquisition's name and the pair it chose."""
        # Loaded by the fit at the latest: no import waits here.
        from .eubo import eubo_pair  # noqa: PLC0415
        from .model_averaging import Average  # noqa: PLC0415

        belief = self._believe()
        if isinstance(belief, Average):
            boldness = self._settings.threshold_boldness
            return "best-option", eubo_pair(belief, boldness[index % len(boldness)], self._last)
        rng = generator(self._seed, Purpose.THOMPSON, index)
        pair = thompson_pair(rng, belief.draw, len(self._candidates), self._last)
        return self._settings.acquisition, pair

    def _covering_pair(self, index: int) -> tuple[int, int] | None:
        """The pair of the first, covering phase at this index, or None after it."""
        if index >= self._settings.threshold_covering:
            return None
        rng = generator(self._seed, Purpose.COVERING, 0)
        sobol = self._settings.threshold_design == "sobol"
        cover = quasi_random_candidates if sobol else farthest_points
        rows = cover(rng, self._candidates.points, 2 * self._settings.threshold_covering)
        # Few candidates are covered before the phase is over.
        pair = rows[2 * index : 2 * index + 2]
        return (int(pair[0]), int(pair[1])) if len(pair) == 2 else None

    def _random_pair(self, index: int) -> tuple[int, int]:
        rng = generator(self._seed, Purpose.RANDOM_PAIR, index)
        return random_pair(rng, len(self._candidates), self._last)

    def _uninformed(self) -> int:
        rng = generator(self._seed, Purpose.UNINFORMED, 0)
        return int(rng.integers(len(self._candidates)))

    def _believe(self) -> "Posterior | Average":
        """The posterior given everything learned so far, fitted when first needed."""
        if self._belief is None:
            # SciPy takes a third of a second to import, which no command should pay that does not
            # fit a model.
            from .model import belief_over  # noqa: PLC0415
            from .model_averaging import average_over  # noqa: PLC0415

            learned = self._learned
            try:
                if self._method.threshold:
                    self._belief = average_over(
                        self._candidates, learned.preferences, learned.skips, self._settings
                    )
                else:
                    self._belief = belief_over(
                        self._candidates, learned.preferences, self._settings, self._prior
                    )
                    self._prior = self._belief.prior
            except FitError as error:
                self._belief = error
        if isinstance(self._belief, FitError):
            raise self._belief
        return self._belief
