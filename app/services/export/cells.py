"""How one value is written in a cell."""

from __future__ import annotations

from datetime import UTC, datetime

Value = str | int | float | bool | datetime | None

#: What a spreadsheet takes for the start of a formula (OWASP, CSV injection).
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


def cell(value: Value) -> str:
    """The value as text; None is empty.

    Times are UTC in ISO 8601 with milliseconds. A text that a spreadsheet would run as a formula
    gets an apostrophe in front, which spreadsheets hide; numbers never need one.
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
