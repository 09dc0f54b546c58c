"""One trial that several people answer: their answers, the queries that are open, the model.

People answer at the same time. A query is numbered by the answers given and the queries open when
it was asked for, so that no two open ones share a number; with the answers so far it determines
every draw made for it.
"""

from collections.abc import Callable, MutableMapping, Sequence
from typing import TYPE_CHECKING, Final, Generic, Literal, Protocol, TypeVar, get_args

from .errors import FitError, PersonError, QueryNotAskedError
from .people_answers import PersonAnswer
from .people_settings import PeopleSettings
from .preferences import Response, SkipReason

if TYPE_CHECKING:
    from .people_model import PeopleFitter, PeopleModel

#: Whose best a query is to find.
Target = Literal["population", "person"]
TARGETS: Final[tuple[Target, ...]] = get_args(Target)


class Indexed(Protocol):
    """A query."""

    @property
    def index(self) -> int: ...


AnyQuery = TypeVar("AnyQuery", bound=Indexed)


#: Full fits, by the answers fitted and the points below everybody's threshold.
FullFits = MutableMapping[tuple[tuple[PersonAnswer, ...], tuple[int, ...]], "PeopleModel"]


class PeopleTrial(Generic[AnyQuery]):
    """Answers of several people, the open queries and the belief, fitted when first needed.

    full_fits: remembers full fits, which are pure functions of their keys for one list of
    candidates and one value of the settings.
    """

    def __init__(self, settings: PeopleSettings, full_fits: FullFits | None = None) -> None:
        self._settings = settings
        self._full_fits = full_fits
        self._history: list[PersonAnswer] = []
        self._open: dict[str | None, AnyQuery] = {}
        self._last: dict[str | None, frozenset[int]] = {}
        self._issued = 0
        self._model: PeopleModel | FitError | None = None
        self._full: tuple[int, tuple[int, ...], PeopleModel] | None = None
        #: Pairs that others are looking at, besides the open queries.
        self.elsewhere: list[frozenset[int]] = []

    @property
    def history(self) -> tuple[PersonAnswer, ...]:
        """Everybody's answers, oldest first."""
        return tuple(self._history)

    @property
    def names(self) -> tuple[str, ...]:
        """The people who have answered, by their first answer."""
        return tuple(dict.fromkeys(answer.person for answer in self._history))

    @property
    def open_queries(self) -> tuple[AnyQuery, ...]:
        """The queries that wait for a response."""
        return tuple(self._open.values())

    @property
    def next_index(self) -> int:
        """The number of the next query."""
        others = len(self._open) + len(self.elsewhere)
        return max(self._issued, len(self._history) + others)

    def last_seen(self, person: str | None) -> frozenset[int]:
        """The rows that the person saw last."""
        return self._last.get(person, frozenset())

    def asked(
        self, person: str | None, propose: Callable[[int, frozenset[int]], AnyQuery]
    ) -> AnyQuery:
        """The query that waits for this person; a new one if none does.

        propose: given the query's number and the rows that the person saw last.
        """
        if person not in self._open:
            query = propose(self.next_index, self.last_seen(person))
            self._issued = query.index + 1
            self._open[person] = query
        return self._open[person]

    def opened(self, query: AnyQuery) -> None:
        """Take a query that was asked for nobody in particular."""
        self._open[None] = query
        self._issued = query.index + 1

    def close(self, query: AnyQuery, person: str) -> None:
        """The query has been answered by this person, or `QueryNotAskedError`."""
        for key in (person, None):
            if key in self._open and self._open[key] == query:
                del self._open[key]
                return
        waiting = self._open.get(person, self._open.get(None))
        raise QueryNotAskedError(
            f"tell: expected the query that waits for {person} "
            f"({'none, ask() comes first' if waiting is None else repr(waiting)}), got {query!r}"
        )

    def reopen(self, reopened: Callable[[AnyQuery], bool]) -> None:
        """Ask anew the open queries that no longer hold."""
        self._open = {key: query for key, query in self._open.items() if not reopened(query)}
        self._model = None

    def record(
        self, person: str, left: int, right: int, response: Response, reason: SkipReason
    ) -> None:
        """Learn from one response."""
        self._history.append(PersonAnswer(person, left, right, response, reason))
        self._issued = max(self._issued, len(self._history))
        self._last[person] = self._last[None] = frozenset((left, right))
        self._model = None

    def forget(self, person: str) -> None:
        """The model is what it would be had this person never answered."""
        if person not in self.names and person not in self._open:
            raise PersonError(f"forget: expected one of {', '.join(self.names)}, got {person!r}")
        self._history = [answer for answer in self._history if answer.person != person]
        self._open.pop(person, None)
        self._last.pop(person, None)
        self._model = self._full = None

    def model(self, fitter: "PeopleFitter", excluded: Sequence[int] = ()) -> "PeopleModel":
        """The belief after everything so far, or `FitError`."""
        if self._model is None:
            first = self._settings.last_full_fit(len(self._history))
            below = tuple(excluded)
            try:
                if self._full is None or self._full[:2] != (first, below):
                    full = self._full_fit(fitter, first, below)
                    self._full = first, below, full
                self._model = fitter.fitted(self._history, below, self._full[2])
            except FitError as error:
                self._model = error
        if isinstance(self._model, FitError):
            raise self._model
        return self._model

    def _full_fit(
        self, fitter: "PeopleFitter", first: int, below: tuple[int, ...]
    ) -> "PeopleModel":
        if self._full_fits is None:
            return fitter.full_fit(self._history[:first], below)
        key = (tuple(self._history[:first]), below)
        full = self._full_fits.get(key)
        if full is None:
            full = self._full_fits[key] = fitter.full_fit(self._history[:first], below)
        return full


def checked_person(person: object) -> str:
    """A person's name, or `PersonError`."""
    if not isinstance(person, str) or not person:
        raise PersonError(f"person: expected a name, got {person!r}")
    return person


def checked_target(target: object) -> Target:
    """Whose best is to be found, or `PersonError`."""
    for known in TARGETS:
        if target == known:
            return known
    raise PersonError(f"target: expected {' or '.join(TARGETS)}, got {target!r}")
