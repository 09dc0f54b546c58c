"""Reads the CSV files that list a study's recordings, one row per video.

The header names every parameter, `file`, and optionally `score`. Rows with equal parameters are
several recordings of one candidate.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from . import numbers
from .files import is_file, misplaced, read_text, within
from .numbers import Doubtful
from .probe_cache import probe
from .validation_errors import Fault, UnreadableFileError

FILE_COLUMN = "file"
SCORE_COLUMN = "score"
FEWEST_CANDIDATES = 2
#: Limits on the work for one study and on the length of the page that lists its faults.
MOST_COLUMNS = 200
MOST_FAULTS = 1_000
# Stricter than Python's own reading, which takes "1_000", "infinity" and Arabic digits too.
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


#: What a video is expected to be: browsers play it without any help.
PLAYABLE = "a video that every browser plays, such as H.264 in MP4"


@dataclass(frozen=True)
class RecordingRow:
    """One recorded run of a candidate, as the study's CSV file lists it.

    `file` is relative to the study folder, with forward slashes.
    """

    environment: str
    candidate: tuple[float, ...]
    file: str
    sha256: str
    duration_s: float
    score: float | None = None


@dataclass(frozen=True)
class _Line:
    """One row as it stands in the file: `number` is the line it begins on."""

    number: int
    cells: Sequence[str]


@dataclass(frozen=True)
class _FoundVideo:
    file: str
    sha256: str
    duration_s: float


class _NoVideoError(Exception):
    """A cell that names no usable video; the message says what was expected and what came."""


@dataclass
class RecordingsReader:
    """Reads the CSV files of one study; a video may occur only once in all of them."""

    root: Path
    decoder: Decoder
    faults: list[Fault] = field(default_factory=list)
    remarks: list[Fault] = field(default_factory=list)
    _rows_by_path: dict[Path, str] = field(default_factory=dict)
    _rows_by_content: dict[str, str] = field(default_factory=dict)

    def read(self, environment: str, source: str, parameters: Sequence[str]) -> list[RecordingRow]:
        """The rows without faults. Empty `parameters`: every other column is a parameter."""
        lines = self._lines(source)
        if not lines:
            return []
        header = [name.strip() for name in lines[0].cells]
        names = list(parameters) or [n for n in header if n not in (FILE_COLUMN, SCORE_COLUMN)]
        if not self._header_is_sound(source, lines[0].number, header, names):
            return []
        rows: list[RecordingRow] = []
        candidates: set[tuple[float, ...]] = set()
        for line in lines[1:]:
            if len(self.faults) >= MOST_FAULTS:
                message = (
                    f"expected fewer faults before this row, got {len(self.faults)}:"
                    " it and all rows after it are not checked yet"
                )
                self._fault(source, line.number, message)
                return rows
            if len(line.cells) != len(header):
                message = f"expected {len(header)} values as in the header, got {len(line.cells)}"
                self._fault(source, line.number, message)
                continue
            cells = dict(zip(header, (cell.strip() for cell in line.cells), strict=True))
            candidate = [self._number(source, line.number, name, cells[name]) for name in names]
            score = None
            if cells.get(SCORE_COLUMN):
                score = self._number(source, line.number, SCORE_COLUMN, cells[SCORE_COLUMN])
            video = self._video(source, line.number, cells[FILE_COLUMN])
            if None in candidate:
                continue
            point = tuple(value for value in candidate if value is not None)
            candidates.add(point)
            if video is not None:
                rows.append(
                    RecordingRow(
                        environment, point, video.file, video.sha256, video.duration_s, score
                    )
                )
        for name in (*names, SCORE_COLUMN):
            self._remark_on_points(source, header, lines, name)
        if len(candidates) < FEWEST_CANDIDATES:
            message = f"expected at least two different candidates, got {len(candidates)}"
            self._fault(source, None, message)
        return rows

    def _lines(self, source: str) -> list[_Line]:
        """All rows with something in them; a blank line between rows does no harm."""
        try:
            text = read_text(self.root, self.root / source)
        except UnreadableFileError as error:
            self._fault(source, error.line, str(error))
            return []
        lines: list[_Line] = []
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        begins = 1
        try:
            for cells in reader:
                if any(cell.strip() for cell in cells):
                    lines.append(_Line(begins, cells))
                begins = reader.line_num + 1
        except csv.Error as error:
            self._fault(source, begins, f"expected values separated by commas, got: {error}")
            return []
        if not lines:
            self._fault(source, None, "expected a header row, got an empty file")
        return lines

    def _header_is_sound(
        self, source: str, line: int, header: Sequence[str], names: Sequence[str]
    ) -> bool:
        if len(header) > MOST_COLUMNS:
            message = f"expected at most {MOST_COLUMNS} columns, got {len(header)}"
            self._fault(source, line, message)
            return False
        expected = [*names, FILE_COLUMN]
        allowed = [*expected, SCORE_COLUMN]
        came = ", ".join(header)
        if len(header) == 1 and ";" in header[0]:
            self._fault(source, line, f"expected columns separated by commas, got {came}")
            return False
        problems = [
            f"expected a column {name}, got {came}" for name in expected if name not in header
        ]
        problems += [
            f"unknown column {name!r}, expected {', '.join(expected)} and optionally {SCORE_COLUMN}"
            for name in dict.fromkeys(header)
            if name not in allowed
        ]
        problems += [
            f"expected each column once, got {name} {header.count(name)} times"
            for name in dict.fromkeys(header)
            if header.count(name) > 1
        ]
        for problem in problems:
            self._fault(source, line, problem)
        return not problems

    def _number(self, source: str, line: int, column: str, cell: str) -> float | None:
        value = float(cell) if NUMBER.fullmatch(cell) else math.nan
        if not math.isfinite(value):
            message = f"{column}: expected a finite number, got {cell!r}{_meant(cell)}"
            self._fault(source, line, message)
            return None
        # Negative zero is the same candidate as zero.
        return value + 0.0

    def _remark_on_points(
        self, source: str, header: Sequence[str], lines: Sequence[_Line], column: str
    ) -> None:
        """Add a remark if numbers with a point could have been meant as thousands."""
        if column not in header:
            return
        place = header.index(column)
        cells = [line.cells[place].strip() for line in lines[1:] if len(line.cells) == len(header)]
        cell = _maybe_thousands([cell for cell in cells if NUMBER.fullmatch(cell)])
        if cell is not None:
            message = f"{column}: {cell} is read as {float(cell):g}, the point as a decimal mark;"
            message += f" write {cell.replace('.', '')} if thousands are meant"
            self.remarks.append(Fault(source, lines[0].number, message))

    def _video(self, source: str, line: int, cell: str) -> _FoundVideo | None:
        try:
            return self._find_video(source, f"{source}:{line}", cell)
        except _NoVideoError as error:
            self._fault(source, line, f"{FILE_COLUMN}: {error}")
            return None

    def _find_video(self, source: str, here: str, cell: str) -> _FoundVideo:
        problem = misplaced(cell)
        if problem is not None:
            raise _NoVideoError(problem)
        path = (self.root / source).parent / cell
        if not within(self.root, path):
            raise _NoVideoError(f"expected a file inside the study folder, got the link {cell!r}")
        first = self._rows_by_path.setdefault(path.resolve(), here)
        if first != here:
            raise _NoVideoError(f"expected each file once, got {cell!r} again (first in {first})")
        if not is_file(path):
            raise _NoVideoError(f"expected a video, there is no file {cell!r}")
        try:
            sha256 = _sha256(path)
            first = self._rows_by_content.setdefault(sha256, here)
            if first != here:
                came = f"got {cell!r} with the same content as the one in {first}"
                raise _NoVideoError(f"expected each video once, {came}")
            video = probe(self.decoder, path, sha256)
        except (UnreadableVideoError, OSError) as error:
            raise _NoVideoError(
                f"expected a video that can be played, got {cell!r}: {error}"
            ) from error
        if video.hindrance is not None:
            raise _NoVideoError(
                f"expected {PLAYABLE}, got {cell!r}: {video.hindrance} (it can be transcoded)"
            )
        self.remarks.extend(
            Fault(source, int(here.rpartition(":")[2]), f"{cell}: {remark}")
            for remark in video.remarks
        )
        return _FoundVideo(path.relative_to(self.root).as_posix(), sha256, video.duration_s)

    def _fault(self, source: str, line: int | None, message: str) -> None:
        self.faults.append(Fault(source, line, message))


def _meant(cell: str) -> str:
    """Advice for a cell that is no number with a decimal point."""
    number = numbers.read(cell)
    if isinstance(number, Doubtful):
        return f" (write {numbers.said(number)}, whichever is meant)"
    return "" if number is None else f" (write {numbers.plain(number)}, with a decimal point)"


def _maybe_thousands(cells: Sequence[str]) -> str | None:
    """The first cell of a column in which no cell shows that a point is a decimal mark.

    A column such as 1.250, 2.500 could be thousands; one with 0.5 or 1.25 in it could not.
    """
    doubtful = [cell for cell in cells if isinstance(numbers.read(cell), Doubtful)]
    others = [cell for cell in cells if "." in cell and cell not in doubtful]
    return doubtful[0] if doubtful and not others else None


def candidates_of(rows: Sequence[RecordingRow], environment: str) -> tuple[tuple[float, ...], ...]:
    """The distinct candidates of an environment, in the order of their first row."""
    return tuple(dict.fromkeys(row.candidate for row in rows if row.environment == environment))


def _sha256(path: Path) -> str:
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
