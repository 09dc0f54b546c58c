"""The type of a result: a tidy table, a text, and further data for its chart."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from app.services.export.cells import cell

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Summary:
    """A table below a figure, as text. Each row is as long as the header."""

    caption: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


@dataclass(frozen=True)
class Result:
    """A result.

    rows: the table of the figure; empty if there is nothing to show. says: text alternative of the
    figure. notes: sentences below it. summaries: tables below it, such as tests. extra: further
    data for the chart.
    """

    rows: Sequence[Row]
    says: str
    notes: tuple[str, ...] = ()
    summaries: tuple[Summary, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)


def as_csv(rows: Sequence[Row]) -> str:
    """The table as CSV, with the columns of its first row, safe to open in spreadsheets."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    if rows:
        columns = list(rows[0])
        writer.writerow(columns)
        writer.writerows([cell(row[column]) for column in columns] for row in rows)
    return text.getvalue()
