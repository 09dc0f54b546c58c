"""Reads a table as people save it: CSV in any dialect, tab-separated text, or an Excel workbook.

Encoding, delimiter and decimal mark are found. `Table.notes` say what was found where it differs
from a CSV in UTF-8 with commas and decimal points.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Final

from . import numbers, workbook
from .files import read_bytes
from .numbers import Doubtful
from .table_encoding import Decoded, decode
from .table_headers import looks_like_header, names_a_video
from .validation_errors import UnreadableFileError

#: Endings of files that are read as tables.
TABLE_ENDINGS: Final = (".csv", ".tsv", ".xlsx")
DELIMITERS: Final = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "vertical bars"}
#: Rows that are looked at to find the delimiter.
_SAMPLE: Final = 200
_SEP_LINE: Final = re.compile(r"\"?sep=(.)\"?[;,\t]*\s*", re.IGNORECASE)
_DECIMAL_COMMA: Final = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]{1,3})?")
_DECIMAL_POINT: Final = re.compile(r"[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]{1,3})?")


@dataclass(frozen=True)
class Line:
    """One row as it stands in the file: `number` is the line it begins on."""

    number: int
    cells: Sequence[str]


@dataclass(frozen=True)
class Table:
    """The header and the rows of a table, cells without blanks around them.

    preamble: lines of the text before the header. comma_columns: the columns whose decimal mark is
    a comma. is_workbook: whether it is one, and no text.
    """

    header: Line
    lines: tuple[Line, ...]
    notes: tuple[str, ...] = ()
    encoding: str = "utf-8"
    has_mark: bool = False
    delimiter: str = ","
    preamble: str = ""
    comma_columns: frozenset[int] = frozenset()
    is_workbook: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether it is a CSV in UTF-8 with commas and decimal points, and nothing before it."""
        return (
            self.encoding == "utf-8"
            and self.delimiter == ","
            and not self.preamble
            and not self.comma_columns
            and not self.is_workbook
        )

    def number(self, column: int, cell: str) -> Decimal | Doubtful | None:
        """The number in a cell of this column; `1,200` is 1.2 where decimal marks are commas."""
        if column not in self.comma_columns:
            found = numbers.read_with_point(cell)
            return numbers.read(cell) if found is None else found
        if _DECIMAL_COMMA.fullmatch(cell):
            return numbers.read_with_point(cell.replace(",", "."))
        return numbers.read(cell)


def read_table(root: Path, path: Path, file_names: Collection[str] = ()) -> Table:
    """Read a table below `root`. file_names: names of files that decide between code pages.

    Raises UnreadableFileError, also for an empty table.
    """
    content = read_bytes(root, path)
    if content.startswith(workbook.OLD_MARK):
        raise UnreadableFileError(
            "expected a CSV or an .xlsx file, got one of an older Excel (.xls): save it as .xlsx"
        )
    if content.startswith(workbook.ZIP_MARK):
        return _of_workbook(content, has_other_name=path.suffix.lower() != ".xlsx")
    return of_text(decode(content, file_names))


def of_text(decoded: Decoded) -> Table:
    """The table in a text. Raises UnreadableFileError."""
    text = decoded.text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    preamble, delimiter, notes = _before_header(text)
    body = text[len(preamble) :]
    delimiter = delimiter or _delimiter(body)
    lines = _lines(body, delimiter, preamble.count("\n") + 1)
    table = _table(lines)
    table = replace(
        table,
        encoding=decoded.encoding,
        has_mark=decoded.has_mark,
        delimiter=delimiter,
        preamble=preamble,
    )
    how = []
    if decoded.encoding != "utf-8":
        how.append(f"in {decoded.name}")
    if delimiter != "," or table.comma_columns:
        decimals = " and decimal commas" if table.comma_columns else ""
        how.append(f"with {DELIMITERS.get(delimiter, repr(delimiter))}{decimals}")
    said = [f"it is read as a table {' '.join(how)}"] if how else []
    return replace(table, notes=(*said, *notes))


def written(table: Table, rows: Sequence[Sequence[str]]) -> bytes:
    """The bytes of a file with these rows, header first, in the dialect of a table of text."""
    out = io.StringIO()
    csv.writer(out, delimiter=table.delimiter, lineterminator="\n").writerows(rows)
    mark = "\ufeff" if table.has_mark else ""
    return f"{mark}{table.preamble}{out.getvalue()}".encode(table.encoding)


def _of_workbook(content: bytes, *, has_other_name: bool) -> Table:
    sheet, rows = workbook.rows(content, looks_like_header)
    width = max((len(cells) for _, cells in rows), default=0)
    table = _table([Line(number, [*cells, *[""] * (width - len(cells))]) for number, cells in rows])
    said = f"it is read as an Excel workbook, sheet {sheet}"
    return replace(table, notes=(said,) if has_other_name else (), is_workbook=True)


def _table(lines: Sequence[Line]) -> Table:
    """The table of these rows; columns and cells at the end that are empty are left out."""
    if not lines:
        raise UnreadableFileError("expected a header row, got an empty file")
    cells = [[cell.strip() for cell in line.cells] for line in lines]
    first = min(
        (next((i for i, cell in enumerate(row) if cell), len(row)) for row in cells), default=0
    )
    header = cells[0][first:]
    while (
        header and not header[-1] and not any(any(row[first:][len(header) - 1 :]) for row in cells)
    ):
        header.pop()
    found = []
    for line, row in zip(lines[1:], cells[1:], strict=True):
        rest = row[first:]
        while len(rest) > len(header) and not rest[-1]:
            rest.pop()
        found.append(Line(line.number, rest))
    return Table(Line(lines[0].number, header), tuple(found), comma_columns=_comma_columns(found))


def _before_header(text: str) -> tuple[str, str | None, list[str]]:
    """The lines before the header, the delimiter that they name, and what to say of them."""
    preamble, delimiter = "", None
    notes: list[str] = []
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        named = _SEP_LINE.fullmatch(line) if not preamble else None
        if named is not None:
            delimiter = named[1]
        elif line.lstrip("\"' ").startswith("#") and not looks_like_header(_split(line)):
            notes.append(f"the comment in line {number} is left aside")
        elif line.strip() or not preamble:
            break
        preamble += line
    return preamble, delimiter, notes


def _split(line: str) -> list[str]:
    return [cell.strip(" \"'\n") for cell in re.split(r"[,;\t|]", line)]


def _delimiter(text: str) -> str:
    """The delimiter under which header and rows agree; a comma if none splits the header."""
    best, found = (False, 0.0, 0), ","
    for delimiter in DELIMITERS:
        rows = []
        try:
            for row in csv.reader(io.StringIO(text, newline=""), delimiter=delimiter):
                if any(cell.strip() for cell in row):
                    rows.append(row)
                if len(rows) > _SAMPLE:
                    break
        except csv.Error:
            continue
        if not rows or len(rows[0]) < 2:
            continue
        agree = sum(len(row) == len(rows[0]) for row in rows) / len(rows)
        has_video = any(names_a_video(cell) for row in rows[1:] for cell in row)
        score = (looks_like_header(rows[0]) or has_video, agree, len(rows[0]))
        if score > best:
            best, found = score, delimiter
    return found


def _lines(text: str, delimiter: str, begins: int) -> list[Line]:
    """All rows with something in them; a blank line between rows does no harm."""
    lines: list[Line] = []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    offset = begins - 1
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                lines.append(Line(begins, cells))
            begins = reader.line_num + offset + 1
    except csv.Error as error:
        name = DELIMITERS.get(delimiter, repr(delimiter))
        message = f"expected values separated by {name}, got: {error}"
        raise UnreadableFileError(message, begins) from error
    return lines


def _comma_columns(lines: Sequence[Line]) -> frozenset[int]:
    """The columns whose decimal marks are commas, since some of them can be nothing else.

    A column without any such mark goes by the other columns.
    """
    commas: Counter[int] = Counter()
    points: Counter[int] = Counter()
    for line in lines:
        for column, cell in enumerate(line.cells):
            if _DECIMAL_COMMA.fullmatch(cell) and isinstance(numbers.read(cell), Decimal):
                commas[column] += 1
            elif _DECIMAL_POINT.fullmatch(cell) and isinstance(numbers.read(cell), Decimal):
                points[column] += 1
    widest = max((len(line.cells) for line in lines), default=0)
    everywhere = bool(commas) and not points
    return frozenset(
        column for column in range(widest) if not points[column] and (commas[column] or everywhere)
    )
