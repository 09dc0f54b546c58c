"""Derives a plan's parameters from a table: names, labels, units and categories of its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from .cell_advice import words
from .numbers import Doubtful
from .parsed_plan import as_list, as_mapping
from .table_headers import UnmatchedColumnsError, is_aside, label_and_unit, match, parameter_name
from .tables import Table

#: Different words in a column that are taken for categories; a column with more is left aside.
MOST_CATEGORIES = 12


@dataclass(frozen=True)
class Derived:
    """A parameter as `study.yaml` has it. values: its categories, none for a number."""

    name: str
    label: str | None = None
    unit: str | None = None
    values: tuple[str, ...] = ()

    def entry(self) -> dict[str, object]:
        """The parameter's entry in `study.yaml`."""
        said = {
            "name": self.name,
            "label": self.label,
            "unit": self.unit,
            "values": list(self.values) or None,
        }
        return {key: value for key, value in said.items() if value is not None}


def derive(table: Table, reserved: Sequence[str] = ()) -> list[Derived]:
    """The parameters in a table: columns of numbers, and of few words that come again.

    Columns that number or describe the rows are none. reserved: names that no parameter may have.
    Raises UnmatchedColumnsError if the table has no column of files.
    """
    header = table.header.cells
    known = match(header, [line.cells for line in table.lines], [])
    found: list[Derived] = []
    for place, text in enumerate(header):
        if place in (known.file, known.score) or is_aside(text) or _numbers_rows(table, place):
            continue
        values: tuple[str, ...] = ()
        if not _is_numeric(table, place):
            different = words(table, place) or []
            if not 2 <= len(different) <= min(MOST_CATEGORIES, max(2, len(table.lines) // 2)):
                continue
            values = tuple(different)
        label, unit = label_and_unit(text)
        name = parameter_name(text, [*reserved, *(one.name for one in found)])
        found.append(Derived(name, None if label == name else label, unit, values))
    return found


def has_files(table: Table) -> bool:
    """Whether the table has a column of files, so that it lists recordings."""
    try:
        match(table.header.cells, [line.cells for line in table.lines], [])
    except UnmatchedColumnsError:
        return False
    return True


def entries_of(data: object) -> list[dict[str, object]]:
    """The parameters of a plan that may have faults, as far as they are mappings."""
    return [dict(as_mapping(one)) for one in as_list(as_mapping(data).get("parameters"))]


def _is_numeric(table: Table, place: int) -> bool:
    """Whether most cells of the column are numbers, certain or doubtful."""
    cells = [line.cells[place] for line in table.lines if place < len(line.cells)]
    numeric = sum(isinstance(table.number(place, cell), Decimal | Doubtful) for cell in cells)
    return not cells or 2 * numeric > len(cells)


def _numbers_rows(table: Table, place: int) -> bool:
    """Whether a column without a name counts the rows: 0, 1, 2, ... or 1, 2, 3, ..."""
    if table.header.cells[place]:
        return False
    cells = [line.cells[place] for line in table.lines if place < len(line.cells)]
    return any(
        cells == [str(number) for number in range(first, first + len(cells))] for first in (0, 1)
    )
