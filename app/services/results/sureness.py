"""How sure trials were of what they acquired, by the number of answers learned from."""

from __future__ import annotations

from statistics import median
from typing import Final

from sqlalchemy.orm import Session

from app.services.export.table import Request

from .data import AcquiredRow, acquired_rows
from .result import Result, Row
from .trial_posterior import percent

_SAID_BY_MODELS: Final = (
    "It is what the models say of themselves. On simulated evaluators it was about right where the"
    " best candidates are hard to find, and too low elsewhere (docs/optimiser.md)."
)


def how_sure(db: Session, request: Request) -> Result:
    """How sure each trial was after each answer that its model learned from."""
    known = [at for at in acquired_rows(db, request) if at.sureness is not None]
    rows: list[Row] = [
        {
            "session_id": at.session,
            "participant_id": at.participant,
            "trial_index": at.trial,
            "condition": at.condition,
            "answers": at.learned,
            "sureness": at.sureness,
            "finished": at.finished,
        }
        for at in known
    ]
    if not rows:
        return Result((), "No trial has a model yet that says how sure it is.")
    within = percent(request.study.plan.within)
    says = (
        "How sure the models are that no candidate is better than the acquired one by more than"
        f" {within} of the range. {' '.join(_at_the_end(known))}"
    )
    return Result(rows, says, (_SAID_BY_MODELS,))


def _at_the_end(known: list[AcquiredRow]) -> list[str]:
    """A sentence per condition about its finished trials, or about those under way."""
    finished = {(at.session, at.trial): at for at in known if at.finished}
    last = finished or {(at.session, at.trial): at for at in known}
    of_condition: dict[str, list[AcquiredRow]] = {}
    for at in last.values():
        of_condition.setdefault(at.condition, []).append(at)
    what = "finished trial" if finished else "trial under way"
    said = []
    for condition, trials in of_condition.items():
        sure = [at.sureness for at in trials if at.sureness is not None]
        many = f"{len(trials)} {what}s" if len(trials) != 1 else f"one {what}"
        answers = median(at.learned for at in trials)
        said.append(
            f"{condition}: {many}, {percent(min(sure))} to {percent(max(sure))},"
            f" median {percent(median(sure))} after {answers:g} answers."
        )
    return said
