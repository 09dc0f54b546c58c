"""The values the optimiser takes and gives: responses, queries, preferences.

Candidates are named by their row in the candidates array throughout.
"""

from dataclasses import dataclass
from numbers import Real
from typing import Final, Literal, get_args

from .errors import SkipReasonError, SurenessError, UnknownResponseError

Response = Literal["left", "right", "skip"]
RESPONSES: Final[tuple[Response, ...]] = get_args(Response)

SkipReason = Literal["both_bad", "cannot_tell"]
SKIP_REASONS: Final[tuple[SkipReason, ...]] = get_args(SkipReason)

TrialType = Literal["random", "model"]
Origin = Literal["answer", "synthesis"]


def checked_response(response: object) -> Response:
    """The response itself, or `UnknownResponseError`."""
    for known in RESPONSES:
        if response == known:
            return known
    raise UnknownResponseError(f"response: expected left, right or skip, got {response!r}")


def checked_reason(reason: object) -> SkipReason:
    """The reason of a skip itself, or `SkipReasonError`."""
    for known in SKIP_REASONS:
        if reason == known:
            return known
    raise SkipReasonError(f"reason: expected {' or '.join(SKIP_REASONS)} or none, got {reason!r}")


def checked_share(name: str, value: object) -> float:
    """A number from 0 to 1, or `SurenessError`."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    share = float(value) if isinstance(value, Real) and number else -1.0
    if not 0.0 <= share <= 1.0:
        raise SurenessError(f"{name}: expected a number from 0 to 1, got {value!r}")
    return share


@dataclass(frozen=True)
class Query:
    """Two candidates to compare, and where the choice of them came from.

    index: 0 for the first query of the trial.
    trial_type: "random" when drawn without regard to the answers, otherwise "model".
    acquisition: what chose it: "random", "random-fallback" (the model could not be fitted),
        "thompson", "knockout", "covering", "best-option".
    seed: the trial's seed; with `index` it determines every draw made for this query.
    """

    index: int
    left: int
    right: int
    trial_type: TrialType
    acquisition: str
    seed: int


@dataclass(frozen=True)
class Preference:
    """What the model learns from: `winner` is preferred over `loser`.

    origin: "answer", or "synthesis" for one made from a skip.
    query_index: the query it is about: the one answered, or the one skipped.
    drawn_from_query_index: for synthesis, the query whose chosen candidate became the winner
        (later than `query_index` when the skip had to wait for a first choice); otherwise None.
    """

    winner: int
    loser: int
    origin: Origin
    query_index: int
    drawn_from_query_index: int | None = None
