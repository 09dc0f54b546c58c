"""Formats one value as a CSV cell."""

from __future__ import annotations

from datetime import UTC, datetime

Value = str | int | float | bool | datetime | None

#: Characters that start a formula in spreadsheets (OWASP, CSV injection).
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


def cell(value: Value) -> str:
    """The value as text; None becomes an empty cell.

    Times are UTC in ISO 8601 with milliseconds. A text that a spreadsheet would evaluate as a
    formula is prefixed with an apostrophe, which spreadsheets hide; numbers never are.
    """
    match value:
        case None:
            return ""
        case bool():
            return "true" if value else "false"
        case datetime():
            moment = value.astimezone(UTC).isoformat(timespec="milliseconds")
            return moment.replace("+00:00", "Z")
        case str():
            return f"'{value}" if value.startswith(_FORMULA_STARTS) else value
        case _:
            return repr(value)
