"""Streams tables as CSV, and files as one zip, in chunks, so that memory use is bounded."""

from __future__ import annotations

import codecs
import csv
import io
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from sqlalchemy.orm import Session

from app.services.context import AppContext

from .cells import Value, cell
from .table import Request, Table

#: Rows in one chunk: some 50 to 100 KB.
_ROWS_PER_PIECE = 500


@dataclass(frozen=True)
class File:
    """A file to be written: its relative path, and a function that yields its content once.

    The function takes a transaction, so that files of one export come from one snapshot.
    """

    path: str
    pieces: Callable[[Session], Iterable[bytes]]


def table_file(table: Table, request: Request, path: str = "") -> File:
    """The table as a CSV file, under its own name unless another path is given."""
    return File(path or f"{table.name}.csv", lambda session: _csv(session, table, request))


def text_file(path: str, text: str) -> File:
    """A text file in UTF-8."""
    return File(path, lambda _session: [text.encode("utf-8")])


def csv_stream(app: AppContext, table: Table, request: Request) -> Iterator[bytes]:
    """The table as CSV: UTF-8, one header row, `\\n` at the end of each line."""
    with app.database.read() as db:
        yield from _csv(db, table, request)


def zip_stream(app: AppContext, files: Iterable[File]) -> Iterator[bytes]:
    """A zip of these files from one snapshot. The same files give the same bytes."""
    with app.database.read() as db:
        yield from zip_within(db, files)


def zip_within(db: Session, files: Iterable[File]) -> Iterator[bytes]:
    """As `zip_stream`, within the caller's transaction."""
    sink = _Sink()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            entry = zipfile.ZipInfo(file.path, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            with archive.open(entry, "w", force_zip64=True) as packed:
                for piece in file.pieces(db):
                    packed.write(piece)
                    yield sink.take()
    yield sink.take()


def _csv(db: Session, table: Table, request: Request) -> Iterator[bytes]:
    header: list[Value] = [column.name for column in table.columns(request.study.plan)]
    yield (codecs.BOM_UTF8 if request.excel else b"") + _lines([header])
    rows = iter(table.rows(db, request))
    while piece := list(islice(rows, _ROWS_PER_PIECE)):
        yield _lines(piece)


def _lines(rows: Iterable[Iterable[Value]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([cell(value) for value in row] for row in rows)
    return text.getvalue().encode("utf-8")


class _Sink(io.RawIOBase):
    """A non-seekable buffer that zipfile writes to and the stream drains."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: object, /) -> int:
        piece = bytes(data)  # type: ignore[call-overload]  # whatever has the buffer protocol
        self._pieces.append(piece)
        return len(piece)

    def take(self) -> bytes:
        taken = b"".join(self._pieces)
        self._pieces.clear()
        return taken
