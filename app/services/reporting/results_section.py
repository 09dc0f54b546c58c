"""The part of a report with the results: each with its figure, its text alternative and tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from sqlalchemy.orm import Session

from app.figures import svg
from app.services.export.table import Request
from app.services.results.charts import draw
from app.services.results.registry import FINDINGS
from app.services.results.result import Result
from app.statistics.comparisons import p_value

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
        tests = found.extra.get("tests", ())
        if tests:
            yield _tests(tests, found)
        else:
            for note in found.notes:
                yield Paragraph(note)


def _tests(tests: Any, found: Result) -> Table:
    numbers: dict[tuple[str, int, str], int] = {}
    for row in found.rows:
        key = (row["environment"], row["answers"], row["condition"])
        numbers[key] = numbers.get(key, 0) + 1
    return Table(
        "Two-sample t-tests, two-sided, equal variances, uncorrected. Difference of the means with"
        " its 95 % interval (Welch); g: Hedges' g",
        ("Environment", "Answers", "Conditions", "Trials", "Difference", "t", "p", "g"),
        [_test(test, numbers) for test in tests],
    )


def _test(test: Mapping[str, Any], numbers: Mapping[tuple[str, int, str], int]) -> tuple[str, ...]:
    sizes = [numbers[test["panel"], test["group"], test[side]] for side in ("first", "second")]
    return (
        test["panel"],
        str(test["group"]),
        f"{test['first']} – {test['second']}",
        f"{sizes[0]}, {sizes[1]}",
        f"{test['difference']:+.3g} [{test['low']:+.3g}, {test['high']:+.3g}]",
        f"t({test['freedom']}) = {test['t']:.3f}",
        f"p {p_value(test['p'])}",
        f"{test['effect']:+.2f}",
    )
