"""Evaluators who answer from the score g of the two runs they are shown (paper section VI)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from app.pbbo import SkipReason

Response = Literal["left", "right", "skip"]

#: Steepness of the uncertain evaluator's choice, per unit of g (paper section VI-A, eta).
ETA = 0.08


class Evaluator(Protocol):
    """Answers one query from the scores of the two runs shown."""

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response: ...


@dataclass(frozen=True)
class Certain:
    """Chooses the better run, the left one of two equals; skips when both lie below a threshold.

    The paper does not say when a simulated evaluator skips. Ours does when both scores lie below
    `skip_below`: the mean of g over W in our experiments. None: never.
    """

    skip_below: float | None = None

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        if may_skip and _both_bad(left, right, self.skip_below):
            return "skip"
        return "left" if left >= right else "right"


@dataclass(frozen=True)
class Uncertain:
    """Chooses the left run with the probability of Bradley and Terry: sigmoid(eta (g0 - g1))."""

    rng: np.random.Generator
    skip_below: float | None = None
    eta: float = ETA

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        if may_skip and _both_bad(left, right, self.skip_below):
            return "skip"
        probability = 1 / (1 + np.exp(-self.eta * (left - right)))
        return "left" if self.rng.random() < probability else "right"


def _both_bad(left: float, right: float, threshold: float | None) -> bool:
    return threshold is not None and left < threshold and right < threshold


@dataclass(frozen=True)
class SkipsEqual:
    """Skips where the g of the two runs differ by less than `within`: where a choice is hard.

    This is what the skip button of PBPO without synthesis is for. usual: who answers all else.
    """

    usual: Evaluator
    within: float

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        if may_skip and abs(left - right) < self.within:
            return "skip"
        return self.usual.respond(left, right, may_skip=False)


@dataclass
class Discerning:
    """Cannot tell two runs apart whose g differ by less than a just-noticeable difference.

    Where both are bad that is what is said; otherwise the skip is a tie.  reason: of the last skip.
    """

    usual: Uncertain
    noticeable: float
    reason: SkipReason | None = None

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        self.reason = None
        response = self.usual.respond(left, right, may_skip=may_skip)
        if response == "skip":
            self.reason = "both_bad"
        elif may_skip and abs(left - right) < self.noticeable:
            self.reason = "cannot_tell"
            return "skip"
        return response


@dataclass(frozen=True)
class Lapsing:
    """Answers at random, left or right, with a small probability; otherwise as another evaluator.

    A lapse says nothing about the runs, and is never a skip.
    """

    rng: np.random.Generator
    usual: Evaluator
    probability: float

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        if self.rng.random() < self.probability:
            return "left" if self.rng.random() < 0.5 else "right"
        return self.usual.respond(left, right, may_skip=may_skip)


@dataclass
class LeftAtFirst:
    """Chooses the left run for the first `queries` queries, whatever is shown."""

    usual: Evaluator
    queries: int
    answered: int = 0

    def respond(self, left: float, right: float, *, may_skip: bool) -> Response:
        self.answered += 1
        if self.answered <= self.queries:
            return "left"
        return self.usual.respond(left, right, may_skip=may_skip)
