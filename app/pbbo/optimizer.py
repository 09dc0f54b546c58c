"""Ask and tell: the only door to the preference optimiser.

A proposal is a pure function of (candidates, method, settings, history, seed, index). Nothing is
carried from one model fit to the next, so an optimiser replayed from stored responses proposes what
the one that never stopped would have, at the cost of one fit.
"""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from .acquisition import random_pair, thompson_pair
from .box import Box
from .box_optimizer import BoxOptimizer
from .candidates import Candidates, FloatArray, IndexArray
from .errors import (
    FitError,
    HistoryError,
    NoPosteriorError,
    PersonError,
    PointError,
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
from .people_settings import PeopleSettings, checked_people_settings
from .people_trial import FullFits, PeopleTrial, Target, checked_person, checked_target
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
    from .people_model import PeopleModel
    from .sureness import Landscapes

# Means this close, in prior standard deviations, differ by rounding alone.
TIE = 1e-9
#: Numbers that are tried for a pair drawn at random that no other person is looking at.
MOST_DRAWS = 20


#: (left, right, response), a skip's reason behind it, and the person behind that.
HistoryEntry = (
    tuple[int, int, str] | tuple[int, int, str, str | None] | tuple[int, int, str, str | None, str]
)


class PreferenceOptimizer:
    """Finds the candidate an evaluator likes best from choices between two.

    candidates: (n, d), finite, at least two different rows. For a `Box` in its place the result is
    a `BoxOptimizer`, which takes the same arguments.  people: how the answers of several people are
    modelled, where `tell` is told whose they are.
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
        *,
        people: PeopleSettings | None = None,
        full_fits: FullFits | None = None,
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
        self._excluded: set[int] = set()
        self._pending: Query | None = None
        self._belief: Posterior | Average | FitError | None = None
        # Depends on the candidates and the settings alone: kept between fits, never learned.
        self._prior: AnyPrior | None = None
        self._people_settings = checked_people_settings(people)
        self._full_fits = full_fits
        self._people: PeopleTrial[Query] | None = None
        #: The model of several people, and the beliefs read from it, by person.
        self._beliefs: tuple[PeopleModel | None, dict[str | None, Average]] = (None, {})

    @classmethod
    def replay(
        cls,
        candidates: Any,
        history: Iterable[HistoryEntry],
        *,
        method: str = "pbpo",
        seed: int = 0,
        settings: Settings | None = None,
        people: PeopleSettings | None = None,
        excluded: Iterable[Any] = (),
        pending: Iterable[tuple[int, int]] = (),
        full_fits: FullFits | None = None,
    ) -> Self:
        """The optimiser after exactly these (left, right, response), oldest first.

        An entry may have the reason of a skip, or None, as a fourth part, and then the person who
        gave the response as a fifth. The queries are taken as stored, whether or not this version
        would have asked them.  excluded: candidates that were excluded meanwhile, in any order.
        pending: pairs that other people are looking at.  full_fits: remembers full fits of several
        people's answers to these candidates under these settings.
        """
        # A box has no such fits to remember.
        kept: dict[str, Any] = {} if full_fits is None else {"full_fits": full_fits}
        optimizer: Self = cls(candidates, method, seed, settings, people=people, **kept)
        for place, entry in enumerate(history):
            left, right, response, reason = optimizer._checked_entry(place, entry)
            if len(entry) == 5:
                optimizer._record_of(checked_person(entry[4]), left, right, response, reason)
            elif optimizer._people is None:
                optimizer._record(left, right, response, reason)
            else:
                raise HistoryError(
                    f"history[{place}]: expected a person, since earlier entries name one"
                )
        for candidate in excluded:
            optimizer.exclude(candidate)
        elsewhere = [frozenset(pair) for pair in pending]
        if elsewhere:
            optimizer._people_trial("replay").elsewhere.extend(elsewhere)
        return optimizer

    def ask(self, person: str | None = None, *, target: str = "population") -> Query:
        """The query that waits for a response; the same one until `tell` or `exclude`.

        person: who will answer, where several people do; each has a query of their own, and no two
        open ones are the same pair while there are others.  target: whose best candidate the query
        is to find, the "population"'s or the "person"'s own.
        """
        whose = checked_target(target)
        if person is None and self._people is None:
            if self._pending is None:
                self._pending = self._propose(self._told, self._last)
            return self._pending
        name = None if person is None else checked_person(person)
        if whose == "person" and name is None:
            raise PersonError("ask: expected a person, whose best is to be found, got none")
        trial = self._people_trial("ask")

        def propose(index: int, last: frozenset[int]) -> Query:
            taken = [frozenset((query.left, query.right)) for query in trial.open_queries]
            return self._propose_to(name, whose, index, last, [*taken, *trial.elsewhere])

        return trial.asked(name, propose)

    def alternatives(
        self, person: str, count: int, *, target: str = "population"
    ) -> tuple[Query, ...]:
        """The query that `ask` would give, and then each that it would give if those before it were
        being judged by another person. The state does not change.
        """
        name, whose = checked_person(person), checked_target(target)
        trial = self._people_trial("alternatives")
        waiting = [frozenset((query.left, query.right)) for query in trial.open_queries]
        taken = [*waiting, *trial.elsewhere]
        first, last = trial.next_index, trial.last_seen(name)
        found: list[Query] = []
        for place in range(count):
            query = self._propose_to(name, whose, first + place, last, taken)
            found.append(query)
            taken.append(frozenset((query.left, query.right)))
        return tuple(found)

    def tell(
        self, query: Query, response: str, reason: str | None = None, *, person: str | None = None
    ) -> None:
        """Take the response to the query that `ask` gave.

        reason: why a query was skipped, "both_bad" or "cannot_tell", for a method that learns from
        it. Without one a skip means what the setting `threshold_skip_means` says.  person: whose
        response it is. Either every response of a trial names a person or none does.
        """
        if person is None and self._people is None:
            if self._pending is None or query != self._pending:
                waiting = (
                    "none, ask() comes first" if self._pending is None else repr(self._pending)
                )
                raise QueryNotAskedError(
                    f"tell: expected the query that waits ({waiting}), got {query!r}"
                )
            checked = checked_response(response)
            self._record(query.left, query.right, *self._method.understood(checked, reason))
            return
        name = checked_person(person)
        trial = self._people_trial("tell")
        understood = self._method.understood(checked_response(response), reason)
        trial.close(query, name)
        self._record_of(name, query.left, query.right, *understood)

    def forget(self, person: str) -> None:
        """Take back everything that this person answered, as if they had never taken part."""
        self._people_trial("forget").forget(checked_person(person))

    def exclude(self, candidate: Any) -> None:
        """Never propose this candidate again, nor name it as the best.

        "pbpo-threshold" learns that it lies below what is acceptable; the other methods learn
        nothing from it. A query that waits for a response is proposed anew if the candidate is in
        it. `PointError` if there is no such candidate, or fewer than two would be left.
        """
        n = len(self._candidates)
        whole = isinstance(candidate, (int, np.integer)) and not isinstance(candidate, bool)
        if not whole or not 0 <= candidate < n:
            raise PointError(f"exclude: expected a candidate from 0 to {n - 1}, got {candidate!r}")
        excluded = self._excluded | {int(candidate)}
        if n - len(excluded) < 2:
            raise PointError(
                "exclude: expected two candidates at least that may still be proposed, "
                f"got {n - len(excluded)} of {n}"
            )
        self._excluded = excluded
        self._belief = None
        if self._pending is not None and candidate in (self._pending.left, self._pending.right):
            self._pending = None
        if self._people is not None:
            self._people.reopen(lambda query: candidate in (query.left, query.right))

    def best(self, person: str | None = None) -> int:
        """The acquired candidate: the largest posterior mean, or knockout's last winner.

        No excluded one. Where several people answer, the population's best; with `person`, that
        person's own. Of equal means the first row. While nothing has been learned every candidate
        is as good as any other, and one drawn from the seed is named. Where the model cannot be
        fitted, the candidate that won most often, counted against its losses.
        """
        n = len(self._candidates)
        if person is not None or self._people is not None:
            return self._best_of_people(person)
        if not self._method.model:
            winner = self._champion()
            return self._uninformed() if winner is None else winner
        if not self._learned.preferences and not (
            self._method.threshold and (self._learned.skips or self._excluded)
        ):
            return self._uninformed()
        try:
            mean, _ = self.posterior()
        except FitError:
            wins = np.zeros(n)
            for preference in self._learned.preferences:
                wins[preference.winner] += 1.0
                wins[preference.loser] -= 1.0
            return self._argmax(wins)
        return self._largest(mean)

    def posterior(self, person: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the latent function at every candidate; each (n,).

        Where several people answer, the population's function; with `person`, that person's.
        `NoPosteriorError` for a method without a model, `FitError` where it cannot be fitted.
        """
        if person is not None or self._people is not None:
            about = None if person is None else checked_person(person)
            with one_thread():
                average = self._people_belief(about)
            return average.mean.copy(), average.std.copy()
        if not self._method.model:
            raise NoPosteriorError(f"posterior: {self._method_name} keeps no model of the answers")
        with one_thread():
            belief = self._believe()
        return belief.mean.copy(), belief.std.copy()

    def sureness(self, within: float, person: str | None = None) -> float:
        """Probability that no candidate is better than `best(person)` by more than `within`.

        within: as a share, from 0 to 1, of the range of f over the candidates. person: as for
        `posterior`. Errors as for `posterior`, and `SurenessError`.
        """
        share = checked_share("within", within)
        return self._landscapes(person).sureness(self.best(person), share)

    def may_be_best(self, probability: float = 0.95) -> tuple[int, ...]:
        """The fewest candidates that hold the best one with this probability, likeliest first."""
        return self._landscapes().may_be_best(checked_share("probability", probability))

    def _landscapes(self, person: str | None = None) -> "Landscapes":
        """Functions drawn from the belief; the same for the same history and seed."""
        from .sureness import Landscapes  # noqa: PLC0415

        if not self._method.model:
            raise NoPosteriorError(f"sureness: {self._method_name} keeps no model of the answers")
        with one_thread():
            rng = generator(self._seed, Purpose.SURENESS, self.responses)
            belief: Posterior | Average
            if person is None and self._people is None:
                belief = self._believe()
            else:
                belief = self._people_belief(None if person is None else checked_person(person))
            return Landscapes(belief, self._allowed(), self.best(person), rng)

    @property
    def preferences(self) -> tuple[Preference, ...]:
        """What has been learned so far, in the order in which it was learned."""
        return self._learned.preferences

    @property
    def responses(self) -> int:
        """How many responses were taken, skips included: the index of the next query."""
        return self._told if self._people is None else len(self._people.history)

    @property
    def people(self) -> tuple[str, ...]:
        """The people who have answered, by their first answer."""
        return () if self._people is None else self._people.names

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
        if not isinstance(entry, (tuple, list)) or len(entry) not in (3, 4, 5):
            raise HistoryError(
                f"history[{place}]: expected (left, right, response), or with a reason behind, "
                f"and a person behind that, got {entry!r}"
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
            reason = entry[3] if len(entry) > 3 else None
            checked = self._method.understood(checked_response(response), reason)
        except (SkipNotOfferedError, SkipReasonError, UnknownResponseError) as error:
            raise type(error)(f"history[{place}]: {error}") from error
        return int(left), int(right), *checked

    def _propose_to(
        self,
        person: str | None,
        target: Target,
        index: int,
        last: frozenset[int],
        taken: Collection[frozenset[int]],
    ) -> Query:
        """A query to one of several people, of the first number from this one that gives a pair not
        among those taken."""
        about = person if target == "person" else None
        for number in range(index, index + MOST_DRAWS):
            query = self._propose(number, last, lambda: self._people_belief(about), taken)
            if query.trial_type == "model" or frozenset((query.left, query.right)) not in taken:
                break
        return query

    def _propose(
        self,
        index: int,
        last: frozenset[int],
        believe: "Callable[[], Average] | None" = None,
        taken: Collection[frozenset[int]] = (),
    ) -> Query:
        """The query of this number. last: the pair not to show again.  believe: the belief to
        choose by, if not the one of one person.  taken: pairs that others are looking at."""
        trial_type, acquisition, pair = self._choose(index, last, believe, taken)
        if generator(self._seed, Purpose.SIDES, index).integers(2):
            pair = pair[::-1]
        return Query(index, pair[0], pair[1], trial_type, acquisition, self._seed)

    def _choose(
        self,
        index: int,
        last: frozenset[int],
        believe: "Callable[[], Average] | None",
        taken: Collection[frozenset[int]],
    ) -> tuple[TrialType, str, tuple[int, int]]:
        if not self._method.model:
            winner = self._champion()
            if winner is None:
                return "random", "random", self._random_pair(index, last)
            rng = generator(self._seed, Purpose.KNOCKOUT, index)
            rows = self._allowed()
            own = int(np.searchsorted(rows, winner))
            opponent = challenger(rng, len(rows), own, self._places(rows, last))
            return "model", "knockout", (winner, int(rows[opponent]))
        if self._method.threshold and self._settings.threshold_covering:
            covering_pair = self._covering_pair(index)
            if covering_pair is not None:
                return "random", "covering", covering_pair
        elif self._answers < self._settings.random_queries:
            return "random", "random", self._random_pair(index, last)
        try:
            with one_thread():
                return "model", *self._model_pair(index, last, believe, taken)
        except FitError:
            # The evaluator goes on; the record says that this query was not the model's.
            return "random", "random-fallback", self._random_pair(index, last)

    def _model_pair(
        self,
        index: int,
        last: frozenset[int],
        believe: "Callable[[], Average] | None",
        taken: Collection[frozenset[int]],
    ) -> tuple[str, tuple[int, int]]:
        """The acquisition's name and the pair it chose."""
        # Loaded by the fit at the latest: no import waits here.
        from .eubo import eubo_pair  # noqa: PLC0415
        from .model_averaging import Average  # noqa: PLC0415

        belief = self._believe() if believe is None else believe()
        if isinstance(belief, Average):
            boldness = self._settings.threshold_boldness[
                index % len(self._settings.threshold_boldness)
            ]
            barred = np.array(sorted(self._excluded), dtype=np.intp)
            return "best-option", eubo_pair(belief, boldness, last, barred=barred, pending=taken)
        rng = generator(self._seed, Purpose.THOMPSON, index)
        rows = self._allowed()
        left, right = thompson_pair(
            rng,
            lambda rng, count: belief.draw(rng, count)[rows],
            len(rows),
            self._places(rows, last),
        )
        return self._settings.acquisition, (int(rows[left]), int(rows[right]))

    def _covering_pair(self, index: int) -> tuple[int, int] | None:
        """The pair of the first, covering phase at this index, or None after it."""
        if index >= self._settings.threshold_covering:
            return None
        rng = generator(self._seed, Purpose.COVERING, 0)
        sobol = self._settings.threshold_design == "sobol"
        cover = quasi_random_candidates if sobol else farthest_points
        allowed = self._allowed()
        points = self._candidates.points[allowed]
        rows = allowed[cover(rng, points, 2 * self._settings.threshold_covering)]
        # Few candidates are covered before the phase is over.
        pair = rows[2 * index : 2 * index + 2]
        return (int(pair[0]), int(pair[1])) if len(pair) == 2 else None

    def _random_pair(self, index: int, last: frozenset[int]) -> tuple[int, int]:
        rng = generator(self._seed, Purpose.RANDOM_PAIR, index)
        rows = self._allowed()
        left, right = random_pair(rng, len(rows), self._places(rows, last))
        return int(rows[left]), int(rows[right])

    def _allowed(self) -> IndexArray:
        """The candidates that may be proposed, ascending."""
        return np.setdiff1d(np.arange(len(self._candidates)), list(self._excluded))

    def _places(self, rows: IndexArray, candidates: Collection[int]) -> frozenset[int]:
        """Where these candidates stand in `rows`; -1 for one that does not."""
        place_of = {int(row): place for place, row in enumerate(rows)}
        return frozenset(place_of.get(candidate, -1) for candidate in candidates)

    def _champion(self) -> int | None:
        """The winner of the last choice, if it may still be proposed."""
        winner = self._learned.last_choice
        return None if winner in self._excluded else winner

    def _argmax(self, values: FloatArray) -> int:
        """The first of the allowed candidates with the largest value."""
        rows = self._allowed()
        return int(rows[np.argmax(values[rows])])

    @property
    def _answers(self) -> int:
        """How many responses were not skips."""
        if self._people is None:
            return self._learned.answers
        return sum(answer.response != "skip" for answer in self._people.history)

    def _largest(self, mean: FloatArray) -> int:
        """The first row whose mean is the largest to within rounding."""
        margin = TIE * float(np.sqrt(self._settings.signal_variance))
        rows = self._allowed()
        return int(rows[np.argmax(mean[rows] >= mean[rows].max() - margin)])

    def _uninformed(self) -> int:
        rng = generator(self._seed, Purpose.UNINFORMED, 0)
        rows = self._allowed()
        return int(rows[rng.integers(len(rows))])

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
                        self._candidates,
                        learned.preferences,
                        learned.skips,
                        self._settings,
                        sorted(self._excluded),
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

    def _people_trial(self, call: str) -> PeopleTrial[Query]:
        """What several people answered; begun when a person is first named."""
        if self._people is None:
            if self._told:
                raise PersonError(
                    f"{call}: expected no person, since {self._told} earlier responses name none"
                )
            if not self._method.threshold:
                raise PersonError(
                    f"{call}: expected the method pbpo-threshold, which knows several people, "
                    f"got {self._method_name}"
                )
            self._people = PeopleTrial(self._people_settings, self._full_fits)
            if self._pending is not None:
                self._people.opened(self._pending)
                self._pending = None
        return self._people

    def _record_of(
        self, person: str, left: int, right: int, response: Response, reason: SkipReason | None
    ) -> None:
        meant = self._settings.threshold_skip_means if reason is None else reason
        self._people_trial("tell").record(person, left, right, response, meant)

    def _best_of_people(self, person: str | None) -> int:
        about = None if person is None else checked_person(person)
        trial = self._people_trial("best")
        if not trial.history:
            return self._uninformed()
        try:
            with one_thread():
                return self._largest(self._people_belief(about).mean)
        except FitError:
            wins = np.zeros(len(self._candidates))
            for answer in trial.history:
                if answer.response != "skip" and about in (None, answer.person):
                    better = answer.left if answer.response == "left" else answer.right
                    wins[[answer.left, answer.right]] -= 1.0
                    wins[better] += 2.0
            return self._argmax(wins)

    def people_model(self) -> "PeopleModel":
        """What the answers say of the people: noises, the share of taste that is their own.

        `PersonError` before anybody has answered, `FitError` where the model cannot be fitted.
        """
        from .people_belief import fitter_over  # noqa: PLC0415

        trial = self._people_trial("people_model")
        if not trial.history:
            raise PersonError("people_model: expected one response at least, got none")
        fitter = fitter_over(self._candidates, self._settings, self._people_settings)
        with one_thread():
            return trial.model(fitter, sorted(self._excluded))

    def _people_belief(self, person: str | None) -> "Average":
        """The belief about the population, or about one person."""
        from .people_belief import belief_of, unlearned_people  # noqa: PLC0415

        if not self._people_trial("posterior").history:
            return unlearned_people(self._candidates, self._settings)
        model = self.people_model()
        if self._beliefs[0] is not model:
            self._beliefs = (model, {})
        known = self._beliefs[1]
        if person not in known:
            known[person] = belief_of(self._candidates, model, person, self._settings)
        return known[person]
