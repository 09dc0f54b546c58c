"""Reads the tables that list a study's recordings, one row per video.

The header names every parameter, `file`, and optionally `score`. Rows with equal parameters are
several recordings of one candidate.
"""

from __future__ import annotations

import hashlib
import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from . import numbers
from .cell_advice import advice
from .file_kind import kind_of
from .file_lookup import FileLookup, NoFileError
from .numbers import Doubtful
from .probe_cache import probe
from .shortening import quoted
from .table_headers import (
    FILE_COLUMN,
    SCORE_COLUMN,
    Columns,
    UnmatchedColumnsError,
    Wanted,
    is_aside,
    label_and_unit,
    match,
)
from .table_source import find_source
from .tables import Line, Table, read_table
from .validation_errors import Fault, UnreadableFileError

FEWEST_CANDIDATES = 2
#: Limits on the work for one study and on the length of the page that lists its faults.
MOST_COLUMNS = 200
MOST_FAULTS = 1_000
#: Columns left aside and converted cells that a remark names.
_MOST_NAMED = 5

#: What a video is expected to be: browsers play it without any help.
PLAYABLE = "a video that every browser plays, such as H.264 in MP4"

#: A parameter's value: a number, or a category as the plan writes it.
Value = float | str


@dataclass(frozen=True)
class ParameterColumn:
    """A parameter as the reader needs it. values: its categories; empty for a number."""

    name: str
    labels: tuple[str, ...] = ()
    unit: str | None = None
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class RecordingRow:
    """One recorded run of a candidate, as the study's table lists it.

    `file` is relative to the study folder, with forward slashes.
    """

    environment: str
    candidate: tuple[Value, ...]
    file: str
    sha256: str
    duration_s: float
    score: float | None = None


@dataclass(frozen=True)
class _FoundVideo:
    file: str
    sha256: str
    duration_s: float


class _NoVideoError(Exception):
    """A cell that names no usable video; the message says what was expected and what came."""

    def __init__(self, message: str, cause: str) -> None:
        super().__init__(message)
        self.cause = cause


@dataclass
class RecordingsReader:
    """Reads the tables of one study; a video may occur only once in all of them.

    remarks: what was understood, and what does no harm. sources: the files that were read, by
    the name that the plan gives them.
    """

    root: Path
    decoder: Decoder
    faults: list[Fault] = field(default_factory=list)
    remarks: list[Fault] = field(default_factory=list)
    sources: dict[str, str] = field(default_factory=dict)
    #: Files that rows name, usable or not, relative to the folder.
    named: set[str] = field(default_factory=set)
    _rows_by_path: dict[Path, str] = field(default_factory=dict)
    _rows_by_content: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._files = FileLookup(self.root)
        #: Of the table being read: numbers in other scripts, and cells that name a file otherwise.
        self._renamed: dict[str, str] = {}
        self._found_elsewhere: dict[str, str] = {}

    def read(
        self, environment: str, source: str, parameters: Sequence[ParameterColumn]
    ) -> list[RecordingRow]:
        """The rows without faults. Empty `parameters`: every other column may be a parameter."""
        table = self._table(source)
        if table is None:
            return []
        columns = self._columns(source, table, parameters)
        if columns is None:
            return []
        if not parameters:
            parameters = [
                ParameterColumn(table.header.cells[place]) for place in columns.parameters
            ]
        rows: list[RecordingRow] = []
        candidates: set[tuple[Value, ...]] = set()
        self._renamed, self._found_elsewhere = {}, {}
        for line in table.lines:
            if len(self.faults) >= MOST_FAULTS:
                message = (
                    f"expected fewer faults before this row, got {len(self.faults)}:"
                    " it and all rows after it are not checked yet"
                )
                self._fault(source, line.number, message)
                return rows
            row = self._row(environment, source, table, columns, parameters, line, candidates)
            if row is not None:
                rows.append(row)
        self._remark_on_table(source, table, columns, parameters)
        if len(candidates) < FEWEST_CANDIDATES:
            message = f"expected at least two different candidates, got {len(candidates)}"
            self._fault(source, None, message)
        return rows

    def _row(
        self,
        environment: str,
        source: str,
        table: Table,
        columns: Columns,
        parameters: Sequence[ParameterColumn],
        line: Line,
        candidates: set[tuple[Value, ...]],
    ) -> RecordingRow | None:
        if len(line.cells) != len(table.header.cells):
            expected, came = len(table.header.cells), len(line.cells)
            message = f"expected {expected} values as in the header, got {came}"
            if came > expected and table.delimiter == ",":
                message += " (a decimal comma needs quotes around the number)"
            self._fault(source, line.number, message, "length")
            return None
        cells = line.cells
        point = [
            self._value(source, table, line, place, parameter)
            for place, parameter in zip(columns.parameters, parameters, strict=True)
        ]
        score = None
        if columns.score is not None and cells[columns.score]:
            wanted = ParameterColumn(SCORE_COLUMN)
            score = self._number(source, table, line, columns.score, wanted)
        video = self._video(source, line.number, cells[columns.file])
        if any(value is None for value in point):
            return None
        candidate = tuple(value for value in point if value is not None)
        candidates.add(candidate)
        if video is None:
            return None
        return RecordingRow(
            environment, candidate, video.file, video.sha256, video.duration_s, score
        )

    def _table(self, source: str) -> Table | None:
        path = find_source(self.root, source)
        found = path.relative_to(self.root).as_posix()
        self.sources[source] = found
        try:
            table = read_table(self.root, path, self._files.names)
        except UnreadableFileError as error:
            self._fault(source, error.line, str(error))
            return None
        if found != source:
            self.remarks.append(Fault(source, None, f"{found} is read in its place"))
        for note in table.notes:
            self.remarks.append(Fault(source, None, note))
        return table

    def _columns(
        self, source: str, table: Table, parameters: Sequence[ParameterColumn]
    ) -> Columns | None:
        header = table.header
        if len(header.cells) > MOST_COLUMNS:
            message = f"expected at most {MOST_COLUMNS} columns, got {len(header.cells)}"
            self._fault(source, header.number, message)
            return None
        rows = [line.cells for line in table.lines]
        wanted = [Wanted(one.name, one.labels) for one in parameters]
        try:
            if wanted:
                return match(header.cells, rows, wanted)
            known = match(header.cells, rows, [])
            free = [
                Wanted(name)
                for place, name in enumerate(header.cells)
                if place not in (known.file, known.score) and not is_aside(name)
            ]
            return match(header.cells, rows, free)
        except UnmatchedColumnsError as error:
            for problem in error.problems:
                self._fault(source, header.number, problem)
            return None

    def _value(
        self, source: str, table: Table, line: Line, place: int, parameter: ParameterColumn
    ) -> Value | None:
        if not parameter.values:
            return self._number(source, table, line, place, parameter)
        cell = line.cells[place]
        for value in parameter.values:
            if _folded(value) == _folded(cell):
                return value
        number = table.number(place, cell)
        plain = numbers.plain(number) if isinstance(number, Decimal) else None
        if plain in parameter.values:
            return plain
        message = (
            f"{parameter.name}: expected one of its values ({', '.join(parameter.values)}),"
            f" got {quoted(cell)}"
        )
        self._fault(source, line.number, message, f"value {parameter.name}")
        return None

    def _number(
        self, source: str, table: Table, line: Line, place: int, parameter: ParameterColumn
    ) -> float | None:
        cell = line.cells[place]
        number = table.number(place, cell)
        # A comma among points is no decimal mark for certain.
        is_other_mark = place not in table.comma_columns and "," in cell
        if isinstance(number, Decimal) and not is_other_mark:
            value = float(number)
            if math.isfinite(value):
                if not cell.isascii() and not parameter.values:
                    self._renamed.setdefault(cell, numbers.plain(number))
                # Negative zero is the same candidate as zero.
                return value + 0.0
        hint = advice(cell, number, table, place, parameter.name)
        message = f"{parameter.name}: expected a finite number, got {quoted(cell)}{hint.text}"
        self._fault(source, line.number, message, f"{hint.cause} {parameter.name}")
        return None

    def _remark_on_table(
        self,
        source: str,
        table: Table,
        columns: Columns,
        parameters: Sequence[ParameterColumn],
    ) -> None:
        """Say what was left aside, converted, or could have been meant otherwise."""
        header = table.header

        def say(message: str) -> None:
            self.remarks.append(Fault(source, header.number, message))

        aside = [name or "one without a name" for name in columns.aside]
        if aside:
            more = f" and {len(aside) - _MOST_NAMED} more" if len(aside) > _MOST_NAMED else ""
            many = "columns are" if len(aside) > 1 else "column is"
            say(f"the {many} left aside: {', '.join(aside[:_MOST_NAMED])}{more}")
        if self._renamed:
            first = next(iter(self._renamed.items()))
            more = f", and {len(self._renamed) - 1} more so" if len(self._renamed) > 1 else ""
            say(f"{quoted(first[0])} is read as {first[1]}{more}")
        if self._found_elsewhere:
            written, file = next(iter(self._found_elsewhere.items()))
            number = len(self._found_elsewhere)
            more = f", and {number - 1} more so" if number > 1 else ""
            say(f"{quoted(written)} is taken for the file {file}{more}")
        places = [*columns.parameters, *([] if columns.score is None else [columns.score])]
        for place in places:
            name = header.cells[place]
            cells = [line.cells[place] for line in table.lines if place < len(line.cells)]
            cell = None if place in table.comma_columns else _maybe_thousands(cells)
            if cell is not None:
                say(
                    f"{name}: {cell} is read as {float(cell):g}, the point as a decimal mark;"
                    f" write {cell.replace('.', '')} if thousands are meant"
                )
        for place, parameter in zip(columns.parameters, parameters, strict=True):
            unit = label_and_unit(header.cells[place])[1]
            if unit and parameter.unit and _folded(unit) != _folded(parameter.unit):
                say(
                    f"{parameter.name}: the table's header says {unit}, the plan says"
                    f" {parameter.unit}"
                )

    def _video(self, source: str, line: int, cell: str) -> _FoundVideo | None:
        try:
            return self._find_video(source, f"{source}:{line}", cell)
        except _NoVideoError as error:
            self._fault(source, line, f"{FILE_COLUMN}: {error}", error.cause)
            return None

    def _find_video(self, source: str, here: str, cell: str) -> _FoundVideo:
        base = (self.root / self.sources[source]).parent
        try:
            path = self._files.find(base, cell)
        except NoFileError as error:
            raise _NoVideoError(str(error), error.cause) from None
        if path != base / cell:
            self._found_elsewhere.setdefault(cell, path.relative_to(self.root).as_posix())
        self.named.add(path.relative_to(self.root).as_posix())
        first = self._rows_by_path.setdefault(path.resolve(), here)
        if first != here:
            message = f"expected each file once, got {quoted(cell)} again (first in {first})"
            raise _NoVideoError(message, "file again")
        try:
            sha256 = _sha256(path)
            first = self._rows_by_content.setdefault(sha256, here)
            if first != here:
                came = f"got {quoted(cell)} with the same content as the one in {first}"
                raise _NoVideoError(f"expected each video once, {came}", "content again")
            video = probe(self.decoder, path, sha256)
        except UnreadableVideoError as error:
            reason = kind_of(path) or str(error)
            raise _NoVideoError(
                f"expected a video that can be played, got {quoted(cell)}: {reason}", reason
            ) from error
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise _NoVideoError(
                f"expected a video that can be played, got {quoted(cell)}: {reason}", reason
            ) from error
        if video.hindrance is not None:
            raise _NoVideoError(
                f"expected {PLAYABLE}, got {quoted(cell)}: {video.hindrance}"
                " (it can be transcoded)",
                f"transcode {video.hindrance}",
            )
        self.remarks.extend(
            Fault(source, int(here.rpartition(":")[2]), f"{cell}: {remark}", remark)
            for remark in video.remarks
        )
        return _FoundVideo(path.relative_to(self.root).as_posix(), sha256, video.duration_s)

    def _fault(self, source: str, line: int | None, message: str, cause: str = "") -> None:
        self.faults.append(Fault(source, line, message, cause))


def _maybe_thousands(cells: Sequence[str]) -> str | None:
    """The first cell of a column in which no cell shows that a point is a decimal mark.

    A column such as 1.250, 2.500 could be thousands; one with 0.5 or 1.25 in it could not.
    """
    pointed = [cell for cell in cells if "." in cell and numbers.read_with_point(cell) is not None]
    doubtful = [cell for cell in pointed if isinstance(numbers.read(cell), Doubtful)]
    return doubtful[0] if doubtful and len(doubtful) == len(pointed) else None


def candidates_of(rows: Sequence[RecordingRow], environment: str) -> tuple[tuple[Value, ...], ...]:
    """The distinct candidates of an environment, in the order of their first row."""
    return tuple(dict.fromkeys(row.candidate for row in rows if row.environment == environment))


def _folded(text: str) -> str:
    return unicodedata.normalize("NFKC", text).casefold().strip()


def _sha256(path: Path) -> str:
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
