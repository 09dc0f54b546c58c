"""Tables as figures take them, and the errors they raise about them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import altair as alt

Row: TypeAlias = Mapping[str, Any]
Table: TypeAlias = Sequence[Row]


class FigureDataError(ValueError):
    """A table that a figure cannot show."""


def require(name: str, table: Table, *columns: str) -> None:
    """Refuse a table without rows, or with a row that lacks a column."""
    if not table:
        raise FigureDataError(f"{name}: expected at least one row, got none")
    for number, row in enumerate(table):
        missing = [column for column in columns if column not in row]
        if missing:
            raise FigureDataError(
                f"{name}: expected the columns {', '.join(columns)}, "
                f"got row {number} without {', '.join(missing)}"
            )


def distinct(table: Table, column: str) -> list[Any]:
    """The values of a column, each once, in the order of their first row."""
    return list(dict.fromkeys(row[column] for row in table))


def where(table: Table, **wanted: Any) -> list[Row]:
    """The rows with these values."""
    return [row for row in table if all(row[name] == value for name, value in wanted.items())]


def inline(rows: Iterable[Row]) -> alt.InlineData:
    """Rows as a chart carries them.

    As one text, since Altair copies and checks each value of a list again and again: a figure of
    maps takes seconds so, and most of that for its rows.
    """
    text = json.dumps([dict(row) for row in rows], separators=(",", ":"))
    return alt.InlineData(values=text, format=alt.JsonDataFormat(type="json"))
