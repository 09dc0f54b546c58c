"""Reads the rows of an Excel workbook (`.xlsx`), within limits on what it may unpack to."""

from __future__ import annotations

import datetime
import io
import zipfile
from collections.abc import Callable, Iterator, Sequence
from typing import Final
from xml.etree.ElementTree import ParseError

from openpyxl import load_workbook
from openpyxl.utils.exceptions import InvalidFileException

from .validation_errors import UnreadableFileError

#: First bytes of a zip, which a workbook is, and of the older `.xls`.
ZIP_MARK: Final = b"PK\x03\x04"
OLD_MARK: Final = b"\xd0\xcf\x11\xe0"
#: Bytes of all parts of a workbook, unpacked: a table of 20,000 videos takes a tenth of it.
LARGEST: Final = 50_000_000
#: A part packs to no less than this share of its size. Repetitive tables stay below it.
LARGEST_RATIO: Final = 200
MOST_ROWS: Final = 100_000
MOST_COLUMNS: Final = 1_000
_MOST_PARTS: Final = 2_000
#: Excel writes no document type; one could hold entities that grow without end.
_DOCUMENT_TYPE: Final = b"<!DOCTYPE"

Row = tuple[int, list[str]]
_DAMAGED = (
    zipfile.BadZipFile,
    InvalidFileException,
    ParseError,
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    NotImplementedError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)


def rows(content: bytes, is_table: Callable[[Sequence[str]], bool]) -> tuple[str, list[Row]]:
    """The name and the rows of the workbook's one sheet with data: row number and cells as text.

    Of several sheets with data, the one with a row among its first for which `is_table` holds.
    Numbers have a decimal point, dates the form 2026-02-01. Raises UnreadableFileError.
    """
    try:
        _require_limits(content)
        book = load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        try:
            sheets = {
                sheet.title: list(_rows(sheet.iter_rows(max_row=MOST_ROWS, max_col=MOST_COLUMNS)))
                for sheet in book.worksheets
                if sheet.sheet_state == "visible"
            }
        finally:
            book.close()
    except _DAMAGED as error:
        raise UnreadableFileError(
            f"expected an Excel workbook (.xlsx), got a damaged one: {error}"
        ) from error
    filled = {name: found for name, found in sheets.items() if found}
    if len(filled) > 1:
        tables = {
            name: found
            for name, found in filled.items()
            if any(is_table(cells) for _, cells in found[:5])
        }
        if len(tables) != 1:
            raise UnreadableFileError(
                "expected one sheet with a column for the files, got"
                f" {len(tables) or 'none'} among {', '.join(filled)}"
            )
        filled = tables
    return next(iter(filled.items()), ("", []))


def _require_limits(content: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parts = archive.infolist()
        if "xl/workbook.xml" not in archive.namelist():
            raise UnreadableFileError("expected a table, got a zip that is no Excel workbook")
        total = sum(part.file_size for part in parts)
        ratio = total / max(1, len(content))
        if len(parts) > _MOST_PARTS or total > LARGEST or ratio > LARGEST_RATIO:
            raise UnreadableFileError(
                f"expected a workbook of at most {LARGEST // 1_000_000} MB unpacked, got"
                f" {total / 1e6:,.0f} MB in {len(parts)} parts"
            )
        for part in parts:
            # The stated size is what the archive reads at the most, whatever follows.
            if part.filename.endswith((".xml", ".rels")) and _DOCUMENT_TYPE in archive.read(part):
                raise UnreadableFileError("expected a plain workbook, got one with a document type")


def _rows(found: Iterator[Sequence[object]]) -> Iterator[Row]:
    for number, cells in enumerate(found, start=1):
        texts = [_text(getattr(cell, "value", None)) for cell in cells]
        while texts and not texts[-1]:
            texts.pop()
        if texts:
            yield number, texts


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, datetime.datetime) and value.time() == datetime.time():
        return value.date().isoformat()
    return str(value).strip()
