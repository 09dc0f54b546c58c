"""The part of a report with the results: each with its figure, its text alternative and tests."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy.orm import Session

from app.figures import svg
from app.services.export.table import Request
from app.services.results import questionnaires
from app.services.results.charts import draw
from app.services.results.registry import FINDINGS

from .document import Block, Figure, Heading, Paragraph, Table


def results(db: Session, request: Request) -> Iterator[Block]:
    """The blocks of this part, in the order of the results page."""
    yield Heading("Results")
    for name, finding in FINDINGS.items():
        found = finding.read(db, request)
        yield Heading(finding.title, 3)
        if found.rows:
            drawing = svg(draw(name, found, request.study))
            yield Figure(finding.about, found.says, drawing)
        yield Paragraph(found.says)
        for note in found.notes:
            yield Paragraph(note)
        for summary in found.summaries:
            yield Table(summary.caption, summary.header, summary.rows)
    asked = questionnaires.summaries(db, request)
    if asked:
        yield Heading("Questionnaires", 3)
        yield Paragraph(
            "Items that were left unanswered are not counted. Texts are in questionnaires.csv."
        )
        for summary in asked:
            yield Table(summary.caption, summary.header, summary.rows)
