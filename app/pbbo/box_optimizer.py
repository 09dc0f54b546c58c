"""Ask and tell where candidates are not a list but a box (`Box`): the same method and belief.

A proposal is a pure function of (box, settings, new, history, pending pairs, excluded and
unavailable points, seed, index). What
the finite optimiser does over all candidates is done here over a design (`box_design`) that is made
afresh for each query from the seed and the belief. The belief itself knows the points shown alone.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from . import box_design
from .box import Box, Key
from .box_query import BoxQuery
from .candidates import FloatArray, IndexArray
from .errors import (
    BoxError,
    FitError,
    HistoryError,
    PbboError,
    PersonError,
    PointError,
    QueryNotAskedError,
    SettingsError,
    UnknownMethodError,
)
from .methods import method_named
from .one_thread import one_thread
from .people_settings import PeopleSettings, checked_people_settings
from .people_trial import PeopleTrial, checked_person, checked_target
from .preferences import (
    Preference,
    Response,
    SkipReason,
    TrialType,
    checked_response,
    checked_share,
)
from .randomness import Purpose, checked_seed, generator
from .safety import LIKELY, Safety
from .settings import Settings
from .skip_synthesis import Learned

if TYPE_CHECKING:
    from .box_belief import BoxBelief, FitToPoints
    from .sureness import Landscapes

#: The one method that knows boxes: the paper's draw functions over all candidates.
BOX_METHOD: Final = "pbpo-threshold"
HistoryEntry = (
    tuple[Any, Any, str] | tuple[Any, Any, str, str | None] | tuple[Any, Any, str, str | None, str]
)


class BoxOptimizer:
    """Finds the point of a box that an evaluator likes best from choices between two.

    new: how many points of a query may be ones that were not shown before, 1 or 2. (The first query
    has two new ones in any case, and so has one when all points shown so far were excluded.) With 1
    every new point is compared with a known one, which costs half the recordings and finds as much.
    people: how the answers of several people are modelled, where `tell` is told whose they are.
    """

    def __init__(
        self,
        space: Box,
        method: str = BOX_METHOD,
        seed: int = 0,
        settings: Settings | None = None,
        *,
        new: int = 1,
        people: PeopleSettings | None = None,
    ) -> None:
        if not isinstance(space, Box):
            raise BoxError(f"space: expected a Box, got {space!r}")
        self._method = method_named(method)
        if method != BOX_METHOD:
            raise UnknownMethodError(f"method: expected {BOX_METHOD} in a box, got {method!r}")
        if isinstance(new, bool) or new not in (1, 2):
            raise SettingsError(f"new: expected 1 or 2, got {new!r}")
        self._box = space
        self._new = new
        self._seed = checked_seed(seed)
        self._settings = Settings() if settings is None else settings
        if not isinstance(self._settings, Settings):
            raise SettingsError(f"settings: expected a Settings value, got {settings!r}")
        self._learned = Learned(seed=self._seed, synthesise=False)
        self._told = 0
        self._shown: list[FloatArray] = []
        self._rows: dict[Key, int] = {}
        self._excluded: dict[Key, FloatArray] = {}
        self._unavailable: set[Key] = set()
        self._last: frozenset[int] = frozenset()
        self._unanswered: list[frozenset[int]] = []
        self._pending: BoxQuery | None = None
        self._belief: BoxBelief | FitError | None = None
        self._whole: FloatArray | None = None
        self._people_settings = checked_people_settings(people)
        self._people: PeopleTrial[BoxQuery] | None = None
        self._people_beliefs: dict[str | None, BoxBelief] = {}

    @classmethod
    def replay(
        cls,
        space: Box,
        history: Iterable[HistoryEntry],
        *,
        method: str = BOX_METHOD,
        seed: int = 0,
        settings: Settings | None = None,
        new: int = 1,
        excluded: Iterable[Any] = (),
        unavailable: Iterable[Any] = (),
        pending: Iterable[tuple[Any, Any]] = (),
        people: PeopleSettings | None = None,
    ) -> Self:
        """The optimiser after exactly these (left, right, response), oldest first.

        An entry may have the reason of a skip, or None, as a fourth part, and then the person who
        gave the response as a fifth.  excluded: points that were excluded meanwhile, in any order.
        unavailable: points that are not proposed although nothing is known against them.
        pending: pairs that are shown and wait for a response, oldest first. They are not proposed
        again, and their points count as shown.
        """
        optimizer = cls(space, method, seed, settings, new=new, people=people)
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
        for point in excluded:
            optimizer.exclude(point)
        for point in unavailable:
            optimizer._unavailable.add(space.key(space.checked_point(point)))
        for pair in pending:
            optimizer._await(*optimizer._checked_pair(pair))
        optimizer._require_two_points()
        return optimizer

    def ask(self, person: str | None = None, *, target: str = "population") -> BoxQuery:
        """The query that waits for a response; the same one until `tell` or `exclude`.

        person, target: as for `PreferenceOptimizer.ask`.
        """
        whose = checked_target(target)
        if person is None and self._people is None:
            if self._pending is None:
                with one_thread():
                    index = self._told + len(self._unanswered)
                    self._pending = self._propose(
                        index, self._last, self._believe, self._unanswered
                    )
            return self._pending
        name = None if person is None else checked_person(person)
        if whose == "person" and name is None:
            raise PersonError("ask: expected a person, whose best is to be found, got none")
        trial = self._people_trial("ask")
        about = name if whose == "person" else None

        def propose(index: int, last: frozenset[int]) -> BoxQuery:
            open_pairs = [(query.left, query.right) for query in trial.open_queries]
            with one_thread():
                believe = partial(self._people_belief, about)
                return self._propose(
                    index + len(self._unanswered), last, believe, self._unanswered, open_pairs
                )

        return trial.asked(name, propose)

    def tell(
        self,
        query: BoxQuery,
        response: str,
        reason: str | None = None,
        *,
        person: str | None = None,
    ) -> None:
        """Take the response to the query that `ask` gave; reason: that of a skip.

        person: whose it is. Either every response of a trial names a person or none does.
        """
        if person is None and self._people is None:
            if self._pending is None or query != self._pending:
                waiting = (
                    "none, ask() comes first" if self._pending is None else repr(self._pending)
                )
                raise QueryNotAskedError(
                    f"tell: expected the query that waits ({waiting}), got {query!r}"
                )
            understood = self._method.understood(checked_response(response), reason)
            self._record(query.left, query.right, *understood)
            return
        name = checked_person(person)
        trial = self._people_trial("tell")
        understood = self._method.understood(checked_response(response), reason)
        trial.close(query, name)
        self._record_of(name, query.left, query.right, *understood)

    def forget(self, person: str) -> None:
        """Take back everything that this person answered, as if they had never taken part."""
        self._people_trial("forget").forget(checked_person(person))
        self._people_beliefs.clear()

    def exclude(self, point: Any) -> None:
        """Never propose this point again, and learn that it is unsafe.

        It lies below what is acceptable, and points near it are less likely to be proposed.

        A query that waits for a response is proposed anew if the point is in it. `PointError` if
        the point is not in the box, or no two points would be left.
        """
        checked = self._box.checked_point(point)
        key = self._box.key(checked)
        self._require_two_points(besides=key)
        self._excluded[key] = checked
        self._belief = None
        waiting = self._pending
        if waiting is not None and key in (
            self._box.key(waiting.left),
            self._box.key(waiting.right),
        ):
            self._pending = None
        if self._people is not None:
            self._people_beliefs.clear()
            self._people.reopen(
                lambda query: key in (self._box.key(query.left), self._box.key(query.right))
            )

    def _require_two_points(self, besides: Key | None = None) -> None:
        """Raise `PointError` if fewer than two points may be proposed, without this one."""
        grid = self._box.grid
        if grid is None:
            return
        left = set(self._box.keys(grid)) - self._excluded.keys() - self._unavailable - {besides}
        if len(left) < 2:
            raise PointError(
                "exclude: expected two points at least that may still be proposed, "
                f"got {len(left)} of {len(grid)}"
            )

    def best(self, person: str | None = None) -> FloatArray:
        """The point with the largest posterior mean over the box; (d,).

        Found by gradient ascent from many starts, and never below the best point shown by mean.
        While nothing has been learned, a point drawn from the seed. No excluded point, and none
        that is likely to be unsafe. Where several people answer, the population's best; with
        `person`, that person's own.
        """
        if person is not None or self._people is not None:
            return self._best_of_people(person)
        if not self._learned.preferences and not self._learned.skips and not self._excluded:
            return self._uninformed()
        with one_thread():
            try:
                belief = self._believe()
            except FitError:
                return self._shown[-1] if self._shown else self._uninformed()
            return belief.maximum()

    def posterior(self, points: Any, person: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the latent function at these points (k, d); (k,) each.

        Where several people answer, of the population's; with `person`, of that person's.
        `FitError` where the model cannot be fitted, `PointError` for points outside the box.
        """
        rows = [self._box.checked_point(point) for point in points]
        if not rows:
            raise PointError("points: expected one at least, got none")
        about = None if person is None else checked_person(person)
        with one_thread():
            return self._belief_about(about).at(np.array(rows))

    def sureness(self, within: float) -> float:
        """Probability that no point of the box is better than `best()` by more than `within`.

        within: as a share, from 0 to 1, of the range of f over the box. Functions are drawn at
        `best()` and at the points that the next query looks at.
        """
        share = checked_share("within", within)
        points, landscapes = self._landscapes()
        return landscapes.sureness(len(points) - 1, share)

    def may_be_best(self, probability: float = 0.95) -> FloatArray:
        """The fewest points that hold the best one with this probability, likeliest first; (k, d).

        Of `best()` and the points that the next query looks at, so that they are a sample of the
        region that holds it.
        """
        share = checked_share("probability", probability)
        points, landscapes = self._landscapes()
        return np.array(points[list(landscapes.may_be_best(share))])

    def _landscapes(self) -> "tuple[FloatArray, Landscapes]":
        """Points (n, d) of which the last is `best()`, and functions drawn at them; the same for
        the same history and seed."""
        from .sureness import MOST_POINTS, Landscapes  # noqa: PLC0415

        with one_thread():
            belief = self._belief_about(None)
            points = belief.design(generator(self._seed, Purpose.REFINING, self.responses))
            points = np.vstack([points, self.best()])
            rng = generator(self._seed, Purpose.SURENESS, self.responses)
            average = belief.over(points)
            best = len(points) - 1
            rows = np.setdiff1d(np.arange(best + 1), self._barred_rows(points))
            return points, Landscapes(average, rows, best, rng, most=MOST_POINTS)

    @property
    def shown(self) -> FloatArray:
        """The different points of queries answered so far, then of those pending; (p, d)."""
        return np.array(self._shown).reshape(-1, self._box.dimensions)

    @property
    def preferences(self) -> tuple[Preference, ...]:
        """What has been learned so far, in order; winner and loser are rows of `shown`."""
        return self._learned.preferences

    @property
    def responses(self) -> int:
        """How many responses were taken, skips included."""
        return self._told if self._people is None else len(self._people.history)

    @property
    def people(self) -> tuple[str, ...]:
        """The people who have answered, by their first answer."""
        return () if self._people is None else self._people.names

    @property
    def settings(self) -> Settings:
        """The settings in force."""
        return self._settings

    def _record(
        self, left: FloatArray, right: FloatArray, response: Response, reason: SkipReason | None
    ) -> None:
        meant = self._settings.threshold_skip_means if reason is None else reason
        one, other = self._row(left), self._row(right)
        self._learned.record(self._told, one, other, response, meant)
        self._told += 1
        self._last = frozenset((one, other))
        self._pending = None
        self._belief = None

    def _await(self, left: FloatArray, right: FloatArray) -> None:
        """Take a pair that is shown and not answered."""
        self._last = frozenset((self._row(left), self._row(right)))
        self._unanswered.append(self._last)
        self._pending = None
        self._belief = None

    def _row(self, point: FloatArray) -> int:
        """The number of a shown point, a new one if it was not shown before."""
        key = self._box.key(point)
        if key not in self._rows:
            self._rows[key] = len(self._shown)
            self._shown.append(point)
        return self._rows[key]

    def _checked_entry(
        self, place: int, entry: object
    ) -> tuple[FloatArray, FloatArray, Response, SkipReason | None]:
        if not isinstance(entry, (tuple, list)) or len(entry) not in (3, 4, 5):
            raise HistoryError(
                f"history[{place}]: expected (left, right, response), or with a reason behind, "
                f"and a person behind that, got {entry!r}"
            )
        try:
            left, right = (self._box.checked_point(point) for point in entry[:2])
            reason = entry[3] if len(entry) > 3 else None
            checked = self._method.understood(checked_response(entry[2]), reason)
        except PbboError as error:
            raise type(error)(f"history[{place}]: {error}") from error
        if self._box.key(left) == self._box.key(right):
            raise HistoryError(
                f"history[{place}]: expected two different points, got {left.tolist()} twice"
            )
        return left, right, *checked

    def _checked_pair(self, pair: object) -> tuple[FloatArray, FloatArray]:
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise HistoryError(f"pending: expected pairs of points, got {pair!r}")
        left, right = (self._box.checked_point(point) for point in pair)
        if self._box.key(left) == self._box.key(right):
            raise HistoryError(f"pending: expected two different points, got {left.tolist()} twice")
        return left, right

    def _propose(
        self,
        index: int,
        last: frozenset[int],
        believe: "Callable[[], BoxBelief]",
        pending: Collection[frozenset[int]],
        open_pairs: Collection[tuple[FloatArray, FloatArray]] = (),
    ) -> BoxQuery:
        """The query of this number.

        last, pending: rows of shown points, pairs not to show again.  open_pairs: pairs of points
        that other people are looking at.
        """
        trial_type, acquisition, pair = self._choose(index, last, believe, pending, open_pairs)
        if generator(self._seed, Purpose.SIDES, index).integers(2):
            pair = pair[::-1]
        for point in pair:
            point.setflags(write=False)
        return BoxQuery(index, pair[0], pair[1], trial_type, acquisition, self._seed)

    def _choose(
        self,
        index: int,
        last: frozenset[int],
        believe: "Callable[[], BoxBelief]",
        pending: Collection[frozenset[int]],
        open_pairs: Collection[tuple[FloatArray, FloatArray]],
    ) -> tuple[TrialType, str, tuple[FloatArray, FloatArray]]:
        known = self._may_be_shown_again()
        first_phase = self._settings.threshold_covering or self._settings.random_queries
        if index < first_phase:
            return "random", "covering", self._first_pair(index, known, open_pairs)
        try:
            pair = self._model_pair(index, known, last, believe, pending, open_pairs)
            return "model", "best-option", pair
        except FitError:
            return "random", "random-fallback", self._first_pair(index, known, open_pairs)

    def _may_be_shown_again(self) -> list[int]:
        """The rows of shown points that may still be proposed."""
        return [row for key, row in self._rows.items() if not self._is_barred(key)]

    def _is_barred(self, key: Key) -> bool:
        return key in self._excluded or key in self._unavailable

    def _first_pair(
        self,
        index: int,
        known: list[int],
        open_pairs: Collection[tuple[FloatArray, FloatArray]],
    ) -> tuple[FloatArray, FloatArray]:
        """Quasi-random points, two for each query; with `new` 1 one, against the last choice."""
        points = box_design.first_points(self._box, generator(self._seed, Purpose.COVERING, 0))
        looked_at = {self._box.key(point) for pair in open_pairs for point in pair}
        unseen = [
            point
            for point, key in zip(points, self._box.keys(points), strict=True)
            if key not in self._rows and key not in looked_at and not self._is_barred(key)
        ]
        safety = self._safety()
        if safety.is_in_doubt:
            # In order, but those that are likely to be refused last.
            likely = safety.probability(np.array(unseen).reshape(-1, points.shape[1])) >= LIKELY
            order = np.argsort(~likely, kind="stable")
            unseen = [unseen[place] for place in order]
        if self._new == 1 and known and unseen:
            choice = self._last_choice()
            row = choice if choice in known else known[-1]
            return self._shown[row], unseen[0]
        if len(unseen) >= 2:
            return unseen[0], unseen[1]
        # A grid of few points: what is left, whether or not it was shown.
        whole = self._allowed_points()
        order = generator(self._seed, Purpose.RANDOM_PAIR, index).permutation(len(whole))
        return whole[order[0]], whole[order[1]]

    def _model_pair(
        self,
        index: int,
        known: list[int],
        last: frozenset[int],
        believe: "Callable[[], BoxBelief]",
        pending: Collection[frozenset[int]],
        open_pairs: Collection[tuple[FloatArray, FloatArray]],
    ) -> tuple[FloatArray, FloatArray]:
        # Loaded when a model is fitted: SciPy takes long to import.
        from .eubo import eubo_pair  # noqa: PLC0415

        belief = believe()
        points = belief.design(generator(self._seed, Purpose.REFINING, index))
        average = belief.over(points)
        safety = self._safety()
        boldness = self._settings.threshold_boldness
        again = np.array(known, dtype=np.intp)
        pair = eubo_pair(
            average,
            boldness[index % len(boldness)],
            last,
            known=again if self._new == 1 and len(again) else None,
            barred=self._barred_rows(points),
            pending=[*pending, *self._rows_of(points, open_pairs)],
            safe=safety.probability(points) if safety.is_in_doubt else None,
        )
        return points[pair[0]], points[pair[1]]

    def _safety(self) -> Safety:
        """The model of what machines can run: what was shown was run."""
        return Safety(self._box, self.shown, self._excluded_points())

    def _excluded_points(self) -> FloatArray:
        excluded = [self._excluded[key] for key in sorted(self._excluded)]
        return np.array(excluded).reshape(-1, self._box.dimensions)

    def _rows_of(
        self, points: FloatArray, pairs: Collection[tuple[FloatArray, FloatArray]]
    ) -> list[frozenset[int]]:
        """Pairs of points by their rows among these, -1 for one that is not."""
        if not pairs:
            return []
        row_of = {key: row for row, key in enumerate(self._box.keys(points))}
        return [frozenset(row_of.get(self._box.key(point), -1) for point in pair) for pair in pairs]

    def _barred_rows(self, points: FloatArray) -> IndexArray:
        rows = [row for row, key in enumerate(self._box.keys(points)) if self._is_barred(key)]
        return np.array(rows, dtype=np.intp)

    def _points_of_whole(self) -> FloatArray:
        if self._whole is None:
            self._whole = box_design.whole(self._box, generator(self._seed, Purpose.DESIGN, 0))
        return self._whole

    def _allowed_points(self) -> FloatArray:
        """Points over the whole box that may be proposed; (n, d)."""
        whole = self._points_of_whole()
        allowed = [not self._is_barred(key) for key in self._box.keys(whole)]
        return whole[allowed]

    def _uninformed(self) -> FloatArray:
        rng = generator(self._seed, Purpose.UNINFORMED, 0)
        whole = self._allowed_points()
        return np.array(whole[int(rng.integers(len(whole)))])

    def _believe(self) -> "BoxBelief":
        if self._belief is None:
            from .box_belief import fit_of_one  # noqa: PLC0415

            try:
                self._belief = self._belief_by(fit_of_one(self._learned, self._settings))
            except FitError as error:
                self._belief = error
        if isinstance(self._belief, FitError):
            raise self._belief
        return self._belief

    def _belief_by(self, fit: "FitToPoints") -> "BoxBelief":
        from .box_belief import BoxBelief  # noqa: PLC0415

        return BoxBelief(
            self._box,
            self._points_of_whole(),
            self.shown,
            self._excluded_points(),
            fit,
            self._settings,
        )

    def _belief_about(self, person: str | None) -> "BoxBelief":
        """The belief about one person's function, the population's where several people answer."""
        if person is None and self._people is None:
            return self._believe()
        return self._people_belief(person)

    def _people_trial(self, call: str) -> PeopleTrial[BoxQuery]:
        """What several people answered; begun when a person is first named."""
        if self._people is None:
            if self._told:
                raise PersonError(
                    f"{call}: expected no person, since {self._told} earlier responses name none"
                )
            self._people = PeopleTrial(self._people_settings)
            if self._pending is not None:
                self._people.opened(self._pending)
                self._pending = None
        return self._people

    def _record_of(
        self,
        person: str,
        left: FloatArray,
        right: FloatArray,
        response: Response,
        reason: SkipReason | None,
    ) -> None:
        meant = self._settings.threshold_skip_means if reason is None else reason
        one, other = self._row(left), self._row(right)
        self._people_trial("tell").record(person, one, other, response, meant)
        self._people_beliefs.clear()

    def _last_choice(self) -> int | None:
        """The row of the point chosen last, if any was."""
        if self._people is None:
            return self._learned.last_choice
        chosen = [answer for answer in self._people.history if answer.response != "skip"]
        if not chosen:
            return None
        return chosen[-1].left if chosen[-1].response == "left" else chosen[-1].right

    def _best_of_people(self, person: str | None) -> FloatArray:
        about = None if person is None else checked_person(person)
        if not self._people_trial("best").history and not self._excluded:
            return self._uninformed()
        with one_thread():
            try:
                return self._people_belief(about).maximum()
            except FitError:
                return self._shown[-1] if self._shown else self._uninformed()

    def _people_belief(self, person: str | None) -> "BoxBelief":
        from .people_belief import fit_of_people  # noqa: PLC0415

        trial = self._people_trial("posterior")
        if not trial.history:
            return self._believe()
        if person not in self._people_beliefs:
            fit = fit_of_people(trial, person, self._settings, self._people_settings)
            self._people_beliefs[person] = self._belief_by(fit)
        return self._people_beliefs[person]
