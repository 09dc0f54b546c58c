"""The participation funnel: how many people reached each step, and where the others stopped."""

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
    """One step of the funnel.

    reached: number of sessions that reached it. share: of all that arrived, 0 to 1. Those that got
    no further are here (active now), away (not seen for the study's lease), or left (declined,
    withdrew, were screened out, or had their data deleted).
    """

    label: str
    reached: int
    share: float
    here: int
    away: int
    left: int


def funnel(lines: Sequence[SessionLine], without_session: int = 0) -> tuple[Step, ...]:
    """The steps, from arrival to completion.

    without_session: number of people who arrived but have no session: declined, or deleted.
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
    """Index of the last step that a session reached."""
    if line.presence == "completed":
        return COMPLETED
    if line.began:
        return BEGAN
    return CONSENTED if line.consented else ARRIVED
