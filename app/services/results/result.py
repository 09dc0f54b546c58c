"""What a finding is: a tidy table, what it says in words, and what its chart needs besides."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from app.services.export.cells import cell

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Result:
    """rows: the table behind a figure, none while there is nothing to show. says: the figure in
    words, for those who do not see it. notes: lines below it, such as tests. extra: what else the
    chart is drawn from."""

    rows: Sequence[Row]
    says: str
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)


def as_csv(rows: Sequence[Row]) -> str:
    """The table as CSV, with the columns of its first row; a spreadsheet runs no cell of it."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    if rows:
        columns = list(rows[0])
        writer.writerow(columns)
        writer.writerows([cell(row[column]) for column in columns] for row in rows)
    return text.getvalue()
