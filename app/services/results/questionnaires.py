"""Summaries of questionnaire answers: per item, and after trials per condition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from app.services.export.table import Request, trials_of
from app.services.export.table import sessions_of as sessions_asked_for
from app.services.sessions.questionnaires import AT_THE_END_INDEX
from app.storage.models.studies import QuestionnaireAnswer, SessionRow, Trial
from app.study.questionnaire import Item
from app.study.stages import AFTER_TRIAL, AT_THE_END

from .result import Summary

#: Where the questionnaire at the end stands, in place of a condition.
_AT_THE_END = "at the end"


def summaries(db: Session, request: Request) -> list[Summary]:
    """A table for each item that was answered: of numbers their spread, of choices their counts.

    Texts are only counted: they are in questionnaires.csv.
    """
    plan = request.study.plan
    given = _answers(db, request)
    found = []
    for page, places in (
        (AFTER_TRIAL, [condition.name for condition in plan.conditions]),
        (AT_THE_END, [_AT_THE_END]),
    ):
        for item in plan.items(page):
            values = {place: given.get((item.name, place), []) for place in places}
            if any(values.values()):
                label = plan.text(item.label, plan.default_language)
                caption = f"{item.name}: {label}"
                found.append(_summary(caption, item, values))
    return found


def _answers(db: Session, request: Request) -> dict[tuple[str, str], list[str]]:
    """The answers of each item, by the trial's condition or the end; none that were left out."""
    after = (
        select(QuestionnaireAnswer.item, Trial.condition, QuestionnaireAnswer.value)
        .join(SessionRow, QuestionnaireAnswer.session_id == SessionRow.id)
        .join(
            Trial,
            and_(
                Trial.session_id == SessionRow.id,
                Trial.trial_index == QuestionnaireAnswer.trial_index,
            ),
        )
        .where(QuestionnaireAnswer.trial_index >= 0, *trials_of(request))
    )
    at_the_end = (
        select(QuestionnaireAnswer.item, QuestionnaireAnswer.value)
        .join(SessionRow, QuestionnaireAnswer.session_id == SessionRow.id)
        .where(QuestionnaireAnswer.trial_index == AT_THE_END_INDEX, *sessions_asked_for(request))
    )
    given: dict[tuple[str, str], list[str]] = {}
    rows = [
        *db.execute(after).all(),
        *((item, _AT_THE_END, value) for item, value in db.execute(at_the_end)),
    ]
    for item, place, value in rows:
        if value is not None:
            given.setdefault((item, place), []).append(value)
    return given


def _summary(caption: str, item: Item, values: dict[str, list[str]]) -> Summary:
    if item.type == "choice":
        names = tuple(item.choices or {})
        header = ("Where", "n", *names)
        return Summary(caption, header, [_counts(place, of, names) for place, of in values.items()])
    if item.type == "text":
        return Summary(
            caption,
            ("Where", "Answers"),
            [(place, str(len(of))) for place, of in values.items()],
        )
    header = ("Where", "n", "Mean", "SD", "Median", "Quartiles", "Range")
    return Summary(caption, header, [_spread(place, of) for place, of in values.items()])


def _counts(place: str, values: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    counted = Counter(values)
    return (place, str(len(values)), *(str(counted[name]) for name in names))


def _spread(place: str, values: Sequence[str]) -> tuple[str, ...]:
    return (place, *_spread_cells(np.array(values, dtype=np.float64)))


def _spread_cells(numbers: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Iterator[str]:
    yield str(len(numbers))
    if not len(numbers):
        yield from [""] * 5
        return
    low, middle, high = np.quantile(numbers, [0.25, 0.5, 0.75])
    yield f"{numbers.mean():.4g}"
    yield f"{numbers.std(ddof=1):.4g}" if len(numbers) > 1 else ""
    yield f"{middle:.4g}"
    yield f"{low:.4g} to {high:.4g}"
    yield f"{numbers.min():.4g} to {numbers.max():.4g}"
