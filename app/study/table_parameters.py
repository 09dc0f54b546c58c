"""Derives a plan's parameters from a table: names, labels and units of its columns of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from .numbers import Doubtful
from .parsed_plan import as_list, as_mapping
from .table_headers import UnmatchedColumnsError, is_aside, label_and_unit, match, parameter_name
from .tables import Table


@dataclass(frozen=True)
class Derived:
    """A parameter as `study.yaml` has it."""

    name: str
    label: str | None = None
    unit: str | None = None

    def entry(self) -> dict[str, object]:
        """The parameter's entry in `study.yaml`."""
        said = {"name": self.name, "label": self.label, "unit": self.unit}
        return {key: value for key, value in said.items() if value is not None}


def derive(table: Table, reserved: Sequence[str] = ()) -> list[Derived]:
    """The parameters in a table: its columns of numbers.

    Columns that number or describe the rows are none. reserved: names that no parameter may have.
    Raises UnmatchedColumnsError if the table has no column of files.
    """
    header = table.header.cells
    known = match(header, [line.cells for line in table.lines], [])
    found: list[Derived] = []
    for place, text in enumerate(header):
        if place in (known.file, known.score) or is_aside(text) or _numbers_rows(table, place):
            continue
        if not _is_numeric(table, place):
            continue
        label, unit = label_and_unit(text)
        name = parameter_name(text, [*reserved, *(one.name for one in found)])
        found.append(Derived(name, None if label == name else label, unit))
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
