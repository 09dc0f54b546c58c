"""How far a person's answers can be relied on: what speaks against it, each reason in words.

Reasons are counted in a person's own sessions (`monitoring.data_quality`), or say that their
choices follow nothing: neither what the others like nor a taste of their own. A person who likes
something else, consistently, is no reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce
from operator import add
from typing import Final

from app.pbbo.people_summary import PersonSummary
from app.services.monitoring.data_quality import (
    FAST_MS,
    FAST_SHARE,
    ONE_SIDED_SHARE,
    Evidence,
    Flag,
    flags_of,
)

#: The probability of a noise of `people_summary.NOISY` or more that is a reason.
LEAST_NOISY: Final = 0.7
#: Fewer answers than these say too little of a person.
FEW_ANSWERS: Final = 8


def of_person(sessions: Iterable[int], evidence: Mapping[int, Evidence]) -> Evidence:
    """The counts of a person's sessions together."""
    return reduce(add, (evidence.get(key, Evidence()) for key in sessions), Evidence())


def reasons(person: PersonSummary, counted: Evidence) -> tuple[str, ...]:
    """What speaks against relying on this person; empty if nothing does."""
    return (*_noise(person), *_counted(counted))


def _noise(person: PersonSummary) -> Iterable[str]:
    if person.noisy >= LEAST_NOISY and person.answers >= FEW_ANSWERS:
        noise = person.noise
        yield (
            "Choices follow neither the taste of the others nor one of their own:"
            f" {noise.value:.1f} times the average noise (90 % interval {noise.low:g} to"
            f" {noise.high:g})."
        )


def _counted(counted: Evidence) -> Iterable[str]:
    raised = flags_of(counted)
    if Flag.ONE_SIDED in raised:
        side = "left" if counted.left >= counted.right else "right"
        most, choices = max(counted.left, counted.right), counted.left + counted.right
        yield (
            f"{most} of {choices} choices were on the {side}; expected fewer than"
            f" {ONE_SIDED_SHARE:.0%}."
        )
    if Flag.FAILED_CHECKS in raised:
        failed = []
        if counted.attention_failed:
            failed.append(f"{counted.attention_failed} of {counted.attention} attention checks")
        if counted.repeats_failed:
            failed.append(f"{counted.repeats_failed} of {counted.repeats} repeats")
        yield f"{' and '.join(failed)} were not answered as expected."
    if Flag.FAST in raised:
        yield (
            f"{counted.fast} of {counted.timed} answers came within {FAST_MS / 1000:g} s of both"
            f" videos having begun; expected fewer than {FAST_SHARE:.0%}."
        )
    if Flag.UNWATCHED in raised:
        yield (
            f"In {counted.unwatched} of {counted.reported} answers less than half of one of the"
            " videos had been played."
        )
