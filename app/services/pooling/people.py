"""All people under a condition: what they like together, each one's own taste, and reliability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import ColumnElement
from sqlalchemy.orm import Session

from app.pbbo.people_summary import PeopleSummary, PersonSummary
from app.services.monitoring import data_quality
from app.services.proposals.people_summaries import NoSummaryError, PeopleSummaries
from app.services.studies.repository import StudyInfo

from . import answers, reliability
from .answers import PooledAnswers

#: The population's best costs a person who differs at least this share of their own range.
DIFFERS: Final = 0.25


@dataclass(frozen=True)
class Person:
    """One person. reasons: against relying on their answers, in words; empty if there are none."""

    summary: PersonSummary
    reasons: tuple[str, ...]

    @property
    def name(self) -> str:
        """The participant's pseudonym."""
        return self.summary.name

    @property
    def differs(self) -> bool:
        """Whether they like something else than the population, by more than their noise explains.

        It says nothing of reliability.
        """
        return self.summary.costs >= DIFFERS and self.summary.noisy < reliability.LEAST_NOISY


@dataclass(frozen=True)
class PooledPeople:
    """The people under a condition. summary: None while it is computed, or if there is none.
    why_not: why there is none, as a sentence."""

    pooled: PooledAnswers
    summary: PeopleSummary | None
    people: tuple[Person, ...]
    why_not: str | None = None

    @property
    def condition(self) -> str:
        return self.pooled.condition

    @property
    def is_computed(self) -> bool:
        """Whether there is a summary, or a reason why there is none."""
        return self.summary is not None or self.why_not is not None

    def candidate(self, row: int) -> int | None:
        """The candidate index of a point; None for one that has not been shown."""
        return self.pooled.candidates[row] if row < len(self.pooled.candidates) else None


def judged_together(
    db: Session,
    summaries: PeopleSummaries,
    study: StudyInfo,
    condition: str,
    modes: Sequence[str],
    *of: ColumnElement[bool],
    waits: bool = True,
) -> PooledPeople:
    """The people under a condition of the plan.

    summaries: where they are cached.  of: conditions on sessions and trials.  waits: whether to
    compute what is not cached, which takes a second for a few people and a minute for two hundred;
    otherwise it is begun in the background.
    """
    pooled = answers.read(db, study, condition, *of)
    if pooled.people < 2:
        number = "one person" if pooled.people else "no one"
        return PooledPeople(
            pooled, None, (), f"Expected answers of two people, {number} has answered."
        )
    try:
        if waits:
            summary: PeopleSummary | None = summaries.find(pooled.request)
        else:
            summary = summaries.find_or_start(pooled.request)
    except NoSummaryError as error:
        return PooledPeople(pooled, None, (), str(error))
    if summary is None:
        return PooledPeople(pooled, None, ())
    counted = data_quality.evidence(db, study.id, modes)
    return PooledPeople(pooled, summary, _people(pooled, summary, counted))


def _people(
    pooled: PooledAnswers, summary: PeopleSummary, counted: Mapping[int, data_quality.Evidence]
) -> tuple[Person, ...]:
    found = []
    for one in summary.people:
        own = reliability.of_person(pooled.sessions[one.name], counted)
        found.append(Person(one, reliability.reasons(one, own)))
    return tuple(found)
