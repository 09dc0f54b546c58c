"""The part of a report on people judged together, a condition at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from sqlalchemy.orm import Session

from app.figures import svg
from app.services.export.table import Request, trials_of
from app.services.pooling.people import PooledPeople, judged_together
from app.services.results import people, people_words
from app.services.results.people_charts import draw_people

from .document import Block, Figure, Heading, Paragraph, Table

#: The figures of a report; the page has more.
FIGURES: Final = ("population", "taste-and-reliability")
#: The table has everybody up to so many people; of more, those who differ or are flagged.
MOST_LISTED: Final = 40


def people_together(db: Session, request: Request) -> Iterator[Block]:
    """The blocks of this part; none where no condition has answers of two people."""
    study = request.study
    parts: list[Block] = []
    for condition in study.plan.conditions:
        if request.conditions and condition.name not in request.conditions:
            continue
        found = judged_together(
            db, request.people, study, condition.name, request.modes, *trials_of(request)
        )
        if found.pooled.people > 1:
            parts += _condition(found, request)
    if parts:
        yield Heading("People judged together")
        for note in people_words.NOTES:
            yield Paragraph(note)
        yield from parts


def _condition(found: PooledPeople, request: Request) -> Iterator[Block]:
    study, summary = request.study, found.summary
    yield Heading(found.condition, 3)
    if summary is None:
        yield Paragraph(found.why_not or "")
        return
    for sentence in people.sentences(found, summary, study.plan):
        yield Paragraph(sentence)
    for name in FIGURES:
        finding = people.PEOPLE_FINDINGS[name]
        result = people.read(name, found, study.plan)
        yield Figure(finding.about, result.says, svg(draw_people(name, result, study)))
    listed = found.people
    if len(listed) > MOST_LISTED:
        listed = tuple(person for person in listed if person.differs or person.reasons)
        yield Paragraph(
            f"The table has the {len(listed)} of {len(found.people)} people who differ or are"
            " flagged; people.csv has all."
        )
    table = people.table_of_people(found, summary, study.plan, listed)
    yield Table(table.caption, table.header, table.rows)
