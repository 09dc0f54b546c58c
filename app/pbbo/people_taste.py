"""Who likes the same things: how alike people's values are, and kinds of taste among them.

Kinds are found by average linkage on one minus the correlation of people's values. They are told
apart only where people of two kinds agree less than half and people of one kind agree well; one
taste that merely varies from person to person has no kinds.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from .candidates import FloatArray, IndexArray

#: Most kinds that are told apart.
MOST_KINDS: Final = 4
#: Fewest people of a kind.
FEWEST_OF_A_KIND: Final = 2
#: Largest mean correlation between people of two kinds, and the least within a kind.
MOST_BETWEEN: Final = 0.5
LEAST_WITHIN: Final = 0.7
#: Least probability that people have tastes of their own at all.
LEAST_OWN: Final = 0.95


@dataclass(frozen=True)
class Kinds:
    """Kinds of taste. number: 1 if none can be told apart.  of: each person's, from 0, the largest
    first."""

    number: int
    of: tuple[int, ...]


def likeness_of(values: FloatArray) -> FloatArray:
    """The correlation of every two people's values (people, n); (people, people).

    A person whose values are all the same has correlation 0 with everyone.
    """
    centred = values - values.mean(axis=1, keepdims=True)
    length = np.sqrt((centred**2).sum(axis=1, keepdims=True))
    unit = np.divide(centred, length, out=np.zeros_like(centred), where=length > 0.0)
    return np.asarray(np.clip(unit @ unit.T, -1.0, 1.0))


def kinds_of(alike: FloatArray, own: float) -> Kinds:
    """The kinds of taste of people with these correlations (people, people).

    own: the probability that people have tastes of their own.
    """
    one = Kinds(1, (0,) * len(alike))
    if own < LEAST_OWN or len(alike) < 2 * FEWEST_OF_A_KIND:
        return one
    distance = 1.0 - alike
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance, checks=False), "average")
    for number in range(MOST_KINDS, 1, -1):
        labels = fcluster(tree, number, "maxclust")
        groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
        if len(groups) == number and _are_apart(alike, groups):
            groups.sort(key=lambda group: (-len(group), int(group[0])))
            of = np.empty(len(alike), dtype=int)
            for place, group in enumerate(groups):
                of[group] = place
            return Kinds(number, tuple(int(kind) for kind in of))
    return one


def _are_apart(alike: FloatArray, groups: list[IndexArray]) -> bool:
    if min(len(group) for group in groups) < FEWEST_OF_A_KIND:
        return False
    for place, group in enumerate(groups):
        inside = alike[np.ix_(group, group)][~np.eye(len(group), dtype=bool)]
        if inside.mean() < LEAST_WITHIN:
            return False
        if any(alike[np.ix_(group, other)].mean() > MOST_BETWEEN for other in groups[:place]):
            return False
    return True
