"""Advice for a cell that is no number, and the cause that it shares with others of its column."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Final

from . import numbers
from .numbers import Doubtful
from .tables import Table

_MONTH: Final = "jan|feb|mar|mär|apr|may|mai|jun|jul|aug|sep|oct|okt|nov|dec|dez"
_DATE: Final = re.compile(
    rf"\d{{4}}-\d\d-\d\d.*|\d{{1,2}}[./]\d{{1,2}}[./]\d{{2,4}}"
    rf"|\d{{1,2}}[.\- ]*({_MONTH})\w*\.?|({_MONTH})\w*\.?[.\- ]*\d{{1,4}}",
    re.IGNORECASE,
)
_WITH_UNIT: Final = re.compile(
    r"([+-]?[0-9]*[.,]?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*((?![eE][0-9])[^\s0-9.,+-].*)"
)
_FRACTION: Final = re.compile(r"[+-]?[0-9]+\s*/\s*[0-9]+")
_NOTHING: Final = frozenset(
    {"", "na", "n/a", "nan", "null", "none", "-", "--", "?", ".", "#n/a", "#nv", "missing"}
)
#: Categories that the advice repeats.
_MOST_VALUES: Final = 6


@dataclass(frozen=True)
class Advice:
    """What to do, as the end of a sentence; and the cause, equal for cells of one kind."""

    text: str
    cause: str


def advice(
    cell: str, number: Decimal | Doubtful | None, table: Table, place: int, name: str
) -> Advice:
    """The advice for a cell of this column of the table, where a number was expected."""
    if isinstance(number, Doubtful):
        return Advice(f" (write {numbers.said(number)}, whichever is meant)", "doubtful number")
    if isinstance(number, Decimal):
        return Advice(f" (write {numbers.plain(number)}, with a decimal point)", "decimal comma")
    if cell.casefold() in _NOTHING:
        return Advice("", "no number")
    return _advice_by_form(cell, name) or _advice_on_words(table, place)


def _advice_by_form(cell: str, name: str) -> Advice | None:
    if _DATE.fullmatch(cell):
        return Advice(
            " (a spreadsheet makes dates of numbers such as 1.2: format the column as text or"
            " number, and type it again)",
            "date",
        )
    if _FRACTION.fullmatch(cell):
        return Advice(" (write it as a decimal number)", "fraction")
    found = _WITH_UNIT.fullmatch(cell)
    if found is None:
        return None
    return Advice(f" (write {found[1]}, and the unit in the header: {name} [{found[2]}])", "unit")


def _advice_on_words(table: Table, place: int) -> Advice:
    values = words(table, place)
    if values is None or len(values) > _MOST_VALUES:
        return Advice("", "not a number")
    listed = ", ".join(values)
    return Advice(
        f" (parameters are numbers: write categories such as {listed} as 0, 1, ...)", "category"
    )


def words(table: Table, place: int) -> list[str] | None:
    """The different cells of a column of words; None if one of them is a number or empty."""
    cells = dict.fromkeys(line.cells[place] for line in table.lines if place < len(line.cells))
    if any(cell.casefold() in _NOTHING or numbers.read(cell) is not None for cell in cells):
        return None
    return list(cells)
