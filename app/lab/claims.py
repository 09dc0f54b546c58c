"""What the paper claims, what came out here, and whether the claim holds.

A claim holds when what it says is true of our results, by the rule given with it. A difference
that the paper calls significant has to be significant here too, in the same direction; where the
paper finds none, none may be significant here. A rule is never chosen after a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.figures.theme import label
from app.statistics.comparisons import Comparison, compare, p_value

from .results import Results


@dataclass(frozen=True)
class Claim:
    """One claim, and our answer.

    name: stable, to refer to it. published: what the paper says, in our words. ours: the same of
    our results. rule: when it holds, and the test behind it.
    """

    name: str
    figure: int
    environment: str
    published: str
    ours: str
    rule: str
    holds: bool

    @property
    def verdict(self) -> str:
        """As the report says it."""
        return "holds" if self.holds else "does not hold"


@dataclass(frozen=True)
class Pair:
    """Two methods, compared after so many queries of one experiment."""

    figure: int
    experiment: str
    environment: str
    first: str
    second: str
    queries: int

    def compare(self, results: Results) -> Comparison:
        """Their values of f."""
        first, second = (
            results.after_queries(self.experiment, self.environment, method, self.queries)
            for method in (self.first, self.second)
        )
        return compare(first, second)

    @property
    def name(self) -> str:
        """Of the claim about this pair."""
        return f"fig{self.figure}-{self.environment}-{self.second}-{self.queries}"

    @property
    def text(self) -> str:
        """For readers."""
        return f"{label(self.first)} against {label(self.second)} after {self.queries} queries"


def better(pair: Pair, results: Results, published_p: str) -> Claim:
    """The paper finds the first significantly better; it holds when that is so here."""
    found = pair.compare(results)
    return Claim(
        pair.name,
        pair.figure,
        pair.environment,
        f"{pair.text}: better, p = {published_p}",
        described(found),
        "t-test, p < .05 and a higher mean",
        found.significant and found.difference > 0,
    )


def alike(pair: Pair, results: Results, published: str = "no difference") -> Claim:
    """The paper finds no difference; it holds when none is significant here."""
    found = pair.compare(results)
    return Claim(
        pair.name,
        pair.figure,
        pair.environment,
        f"{pair.text}: {published}",
        described(found),
        "t-test, p ≥ .05",
        not found.significant,
    )


def described(found: Comparison) -> str:
    """A comparison in one line."""
    return (
        f"difference {found.difference:+.1f} [{found.low:+.1f}, {found.high:+.1f}], "
        f"p {p_value(found.p)}, g = {found.effect:+.2f}"
    )


def mean(values: Sequence[float]) -> float:
    """Of a sample that is not empty."""
    return sum(values) / len(values)
