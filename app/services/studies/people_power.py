"""How many people of how many answers are needed: a job on simulated people, and its result."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Self

from app.services import jobs
from app.services.accounts import audit_log
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError

from .repository import StudyInfo

#: The kind of job.
POWER: Final = "power"
#: Limits of the page, whose job would otherwise take hours; the command line has wider ones.
MOST_NUMBERS: Final = 5
MOST_PEOPLE: Final = 50
MOST_ANSWERS: Final = 50
MOST_SETS: Final = 100


@dataclass(frozen=True)
class PowerRequest:
    """What is computed, as `pbpo power` takes it.

    people, answers: numbers of people, and of answers of each. own_share: share of the variance of
    people's taste that is their own. within: regret that is small enough, as a share of the range.
    sets: simulated sets of people.
    """

    people: tuple[int, ...] = (3, 6, 12)
    answers: tuple[int, ...] = (5, 10, 20)
    own_share: float = 0.3
    within: float = 0.1
    sets: int = 20
    seed: int = 0

    @classmethod
    def from_form(
        cls, people: str, answers: str, own_share: float, within: float, sets: int, seed: int
    ) -> Self:
        """The request of a form, whose numbers are separated by commas. Raises ConflictError."""
        return cls(
            _numbers("numbers of people", people, MOST_PEOPLE),
            _numbers("numbers of answers", answers, MOST_ANSWERS),
            own_share,
            within,
            sets,
            seed,
        )

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """As a job has it."""
        lists = {name: tuple(stored[name]) for name in ("people", "answers")}
        return cls(**{**stored, **lists})

    def as_json(self) -> dict[str, Any]:
        """As a job has it."""
        return {**vars(self), "people": list(self.people), "answers": list(self.answers)}


class PowerLine(NamedTuple):
    """Mean regret with its standard error, in words, by each way of judging."""

    people: int
    answers: int
    shared: str
    pooled: str
    own: str


@dataclass(frozen=True)
class Power:
    """The newest job of a study. lines, says: its result, empty while it is not done."""

    job: jobs.JobInfo
    asked: PowerRequest
    lines: tuple[PowerLine, ...] = ()
    says: tuple[str, ...] = ()


def ask(app: AppContext, caller: Principal, study: StudyInfo, asked: PowerRequest) -> None:
    """Start the job."""
    jobs.enqueue(app, caller, POWER, asked.as_json(), study.id)
    audit_log.note_alone(app, caller.email, "numbers of people asked for", study.slug)


def newest(app: AppContext, study: StudyInfo) -> Power | None:
    """The newest job of the study with its result, or None."""
    job = jobs.newest(app, POWER, study_id=study.id)
    if job is None:
        return None
    asked = PowerRequest.from_json(job.request)
    if job.state != jobs.DONE:
        return Power(job, asked)
    found = json.loads(job.message or "{}")
    return Power(
        job, asked, tuple(PowerLine(*line) for line in found["lines"]), tuple(found["says"])
    )


def _numbers(what: str, typed: str, most: int) -> tuple[int, ...]:
    parts = [part for part in re.split(r"[,\s]+", typed.strip()) if part]
    numbers = [int(part) for part in parts if re.fullmatch(r"[0-9]{1,4}", part)]
    fits = len(numbers) == len(parts) and all(1 <= number <= most for number in numbers)
    if not numbers or not fits or len(numbers) > MOST_NUMBERS:
        raise ConflictError(
            f"{what}: expected 1 to {MOST_NUMBERS} whole numbers from 1 to {most} with commas"
            f" between them, such as 3, 6, 12, got {typed.strip()!r}"
        )
    return tuple(sorted(set(numbers)))
