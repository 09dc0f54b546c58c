"""From responses to preferences: answers, and query synthesis from skips (Section IV-B).

A skip of (A, B) says that both are undesirable. A candidate C is drawn from those chosen so far in
the trial, and C > A and C > B are learned. While nothing has been chosen the skip waits in a pool,
and is synthesised at the first choice.

The paper does not say what happens when the drawn candidate is A or B itself (chosen once, skipped
later). A candidate cannot be preferred over itself, so here the draw is among the choices other
than A and B; if there are none, the skip waits like one without any choice. A candidate chosen
twice is twice as likely to be drawn: the draw is over the answers.
"""

from typing import NamedTuple

from .preferences import Preference, Response, SkipReason
from .randomness import Purpose, generator


class Choice(NamedTuple):
    """An answer: the chosen candidate and the query it was chosen in."""

    candidate: int
    query_index: int


class Skip(NamedTuple):
    """A skipped query, and why it was skipped."""

    left: int
    right: int
    query_index: int
    reason: SkipReason = "both_bad"


class Learned:
    """The preferences of one trial, as its responses come in."""

    def __init__(self, *, seed: int, synthesise: bool) -> None:
        self._seed = seed
        self._synthesise = synthesise
        self._choices: list[Choice] = []
        self._pool: list[Skip] = []
        self._skips: list[Skip] = []
        self._preferences: list[Preference] = []

    @property
    def preferences(self) -> tuple[Preference, ...]:
        """In the order in which they were learned."""
        return tuple(self._preferences)

    @property
    def skips(self) -> tuple[Skip, ...]:
        """Every skip so far, whether or not it was synthesised."""
        return tuple(self._skips)

    @property
    def answers(self) -> int:
        """How many responses were not skips."""
        return len(self._choices)

    @property
    def last_choice(self) -> int | None:
        """The candidate chosen last, if any was."""
        return self._choices[-1].candidate if self._choices else None

    def record(
        self,
        index: int,
        left: int,
        right: int,
        response: Response,
        reason: SkipReason = "both_bad",
    ) -> None:
        """Learn from the response to the query of this index. reason: that of a skip."""
        if response == "skip":
            skip = Skip(left, right, index, reason)
            self._skips.append(skip)
            if self._synthesise:
                self._pool.append(skip)
                self._empty_pool()
            return
        winner, loser = (left, right) if response == "left" else (right, left)
        self._choices.append(Choice(winner, index))
        self._preferences.append(Preference(winner, loser, "answer", index))
        self._empty_pool()

    def _empty_pool(self) -> None:
        waiting: list[Skip] = []
        for skip in self._pool:
            eligible = [c for c in self._choices if c.candidate not in (skip.left, skip.right)]
            if not eligible:
                waiting.append(skip)
                continue
            rng = generator(self._seed, Purpose.SYNTHESIS, skip.query_index)
            drawn = eligible[int(rng.integers(len(eligible)))]
            self._preferences += [
                Preference(drawn.candidate, loser, "synthesis", skip.query_index, drawn.query_index)
                for loser in (skip.left, skip.right)
            ]
        self._pool = waiting
