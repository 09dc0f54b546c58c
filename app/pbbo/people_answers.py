"""The answers of several people as functionals of their latent values, padded to common shapes.

The values that answers name are numbered afresh: the threshold is 0, the tie width 1, and the
points follow in the order in which they were first shown, so that the numbers of an earlier moment
are those of a later one. People with about as many answers are kept in one array, with zeros
behind those who gave fewer; a row of zeros is an answer that says nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .candidates import FloatArray, IndexArray
from .preferences import Response, SkipReason

#: Numbers of the threshold and of the tie width, and of the first point.
THRESHOLD: Final = 0
TIE_WIDTH: Final = 1
FIRST_POINT: Final = 2
#: Sizes are rounded up to a multiple of their nearest power of two over this.
SIZE_STEPS: Final = 2
SMALLEST_SIZE: Final = 8
#: The number of no person: what holds for everybody alike.
EVERYBODY: Final = 2**31


class PersonAnswer(NamedTuple):
    """One response: who gave it, the rows of the two candidates shown, and a skip's meaning."""

    person: str
    left: int
    right: int
    response: Response
    reason: SkipReason


class Functional(NamedTuple):
    """A probit observation of value[winner] - value[loser] + margin * tie width + side * side's.

    side: 1 where the left one was chosen, -1 for the right one, 0 where sides have no part.
    """

    winner: int
    loser: int
    margin: int
    side: int


@dataclass(frozen=True, eq=False)
class Group:
    """People with about as many answers, k of them, padded to m answers about s values.

    people: (k,), their numbers, or `EVERYBODY`.  values: (k, s), the values named, and `dummy`
    behind them.  features: (k, m, s).  sides: (k, m).  counts: (k, m), 0 where there is no answer.
    choices: (k, m), where two candidates are compared with each other.
    own: (k,), 1 for a person, 0 for what holds for everybody alike.
    """

    people: IndexArray
    values: IndexArray
    features: FloatArray
    sides: FloatArray
    counts: FloatArray
    choices: NDArray[np.bool_]
    own: FloatArray


@dataclass(frozen=True, eq=False)
class PeopleAnswers:
    """Everybody's answers. points: (p,), the rows of the points in them, by first appearance."""

    names: tuple[str, ...]
    points: IndexArray
    groups: tuple[Group, ...]

    @property
    def size(self) -> int:
        """How many values there are: the points, the threshold and the tie width."""
        return len(self.points) + FIRST_POINT


def functionals(
    answers: Sequence[PersonAnswer], place: Mapping[int, int], *, ties: bool
) -> list[Functional]:
    """What these answers say, as `threshold` says of one person's. ties: whether the tie width has
    a part in choices."""
    margin = -1 if ties else 0
    found: list[Functional] = []
    for answer in answers:
        left, right = place[answer.left], place[answer.right]
        if answer.response == "skip":
            if answer.reason == "cannot_tell":
                found += [Functional(left, right, 1, 0), Functional(right, left, 1, 0)]
            else:
                found += [Functional(THRESHOLD, below, 0, 0) for below in (left, right)]
            continue
        winner, loser, side = (left, right, 1) if answer.response == "left" else (right, left, -1)
        found += [Functional(winner, loser, margin, side), Functional(winner, THRESHOLD, 0, 0)]
    return found


def people_answers(
    history: Sequence[PersonAnswer],
    threshold_noise: float,
    *,
    shared_ties: bool,
    excluded: Sequence[int] = (),
    points: Sequence[int] | None = None,
    only: frozenset[str] | None = None,
) -> PeopleAnswers:
    """The answers of a history.

    threshold_noise: of a comparison with the threshold, as a share of that of two candidates.
    shared_ties: whether what one person says of ties tells of another's.  excluded: points that
    lie below everybody's threshold.  points: if given, the order of the points.  only: if given,
    whose answers to take; the others only decide which points and people there are.
    """
    if points is None:
        points = points_of(history, excluded)
    place = {row: number for number, row in enumerate(points, start=FIRST_POINT)}
    names = tuple(dict.fromkeys(answer.person for answer in history))
    of: dict[str, list[PersonAnswer]] = {name: [] for name in names}
    for answer in history:
        of[answer.person].append(answer)
    tied = {a.person for a in history if a.response == "skip" and a.reason == "cannot_tell"}
    anybody = shared_ties and bool(tied)
    rows = {
        number: functionals(of[name], place, ties=anybody or name in tied)
        for number, name in enumerate(names)
        if only is None or name in only
    }
    if excluded and only is None:
        rows[EVERYBODY] = [Functional(THRESHOLD, place[below], 0, 0) for below in excluded]
    return PeopleAnswers(
        names,
        np.array(points, dtype=np.intp),
        tuple(grouped(rows, len(points) + FIRST_POINT, 1.0 / threshold_noise)),
    )


def points_of(history: Sequence[PersonAnswer], excluded: Sequence[int] = ()) -> list[int]:
    """The rows named, each once, by first appearance."""
    shown = [row for answer in history for row in (answer.left, answer.right)]
    return list(dict.fromkeys([*shown, *excluded]))


def padded_size(count: int) -> int:
    """The size of the arrays that so many rows are kept in."""
    if count <= SMALLEST_SIZE:
        return SMALLEST_SIZE
    step = (1 << (count.bit_length() - 1)) // SIZE_STEPS
    return -(-count // step) * step


def grouped(rows: Mapping[int, Sequence[Functional]], dummy: int, sharp: float) -> list[Group]:
    """Functionals of each person, in groups. dummy: the number of no value.  sharp: factor of a
    comparison with the threshold."""
    distinct = {}
    by_size: dict[int, list[int]] = {}
    for number, functionals_of in rows.items():
        different, counts = np.unique(
            np.array(functionals_of, dtype=np.intp).reshape(-1, 4), axis=0, return_counts=True
        )
        distinct[number] = different, counts
        by_size.setdefault(padded_size(len(different)), []).append(number)
    groups = []
    for size in sorted(by_size):
        numbers = by_size[size]
        named = [np.unique(distinct[number][0][:, :2]) for number in numbers]
        named = [
            np.union1d(values, [TIE_WIDTH]) if distinct[number][0][:, 2].any() else values
            for values, number in zip(named, numbers, strict=True)
        ]
        width = max(len(values) for values in named)
        group = Group(
            np.array(numbers, dtype=np.intp),
            np.full((len(numbers), width), dummy, dtype=np.intp),
            np.zeros((len(numbers), size, width)),
            np.zeros((len(numbers), size)),
            np.zeros((len(numbers), size)),
            np.zeros((len(numbers), size), dtype=np.bool_),
            np.array([float(number != EVERYBODY) for number in numbers]),
        )
        for k, (number, values) in enumerate(zip(numbers, named, strict=True)):
            different, counts = distinct[number]
            at = np.arange(len(different))
            winner, loser, margin, side = different.T
            group.values[k, : len(values)] = values
            features = group.features[k]
            features[at, np.searchsorted(values, winner)] += 1.0
            features[at, np.searchsorted(values, loser)] -= 1.0
            tied = np.flatnonzero(margin)
            if len(tied):
                features[tied, np.searchsorted(values, TIE_WIDTH)] += margin[tied]
            with_threshold = (winner == THRESHOLD) | (loser == THRESHOLD)
            features[at[with_threshold]] *= sharp
            group.choices[k, at] = ~with_threshold
            group.sides[k, at] = side
            group.counts[k, at] = counts
        groups.append(group)
    return groups
