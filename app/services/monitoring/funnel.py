"""How far people came: from arriving to the end, and where they were lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from .session_list import SessionLine

ARRIVED, CONSENTED, BEGAN, COMPLETED = range(4)

LABELS: Final = MappingProxyType(
    {
        ARRIVED: "Arrived",
        CONSENTED: "Consented",
        BEGAN: "Began the queries",
        COMPLETED: "Completed",
    }
)


@dataclass(frozen=True)
class Step:
    """One step of the way.

    reached: how many came this far. share: of all that arrived, 0 to 1. The others are those who
    came no further: here, under way at this moment; away, not heard of for the study's lease; left,
    who declined, withdrew, were screened out or had all deleted.
    """

    label: str
    reached: int
    share: float
    here: int
    away: int
    left: int


def funnel(lines: Sequence[SessionLine], without_session: int = 0) -> tuple[Step, ...]:
    """The steps, from arriving to the end.

    without_session: how many arrived of whom there is no session: declined, or deleted.
    """
    arrived = len(lines) + without_session
    reached = [how_far(line) for line in lines]

    def number(step: int, counts: Callable[[SessionLine], bool]) -> int:
        return sum(at == step and counts(line) for at, line in zip(reached, lines, strict=True))

    steps = []
    for step, label in LABELS.items():
        came = sum(at >= step for at in reached) if step else arrived
        steps.append(
            Step(
                label,
                came,
                came / arrived if arrived else 0.0,
                number(step, lambda line: line.presence == "here"),
                number(step, lambda line: line.presence == "away"),
                number(step, lambda line: line.presence == "left")
                + (0 if step else without_session),
            )
        )
    return tuple(steps)


def how_far(line: SessionLine) -> int:
    """The last step that a session came to."""
    if line.presence == "completed":
        return COMPLETED
    if line.began:
        return BEGAN
    return CONSENTED if line.consented else ARRIVED
