"""Transcodes videos in a study's folder that some browsers cannot play."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from .file_lookup import FileLookup, NoFileError
from .files import is_file
from .table_headers import UnmatchedColumnsError, match
from .tables import TABLE_ENDINGS, Table, read_table, written
from .validation_errors import UnreadableFileError

#: Callback with the seconds done and the seconds in total.
Report = Callable[[int, int], None]


def transcode_folder(folder: Path, report: Report, *, keep: bool) -> list[str]:
    """Transcode every video listed in the folder's tables that some browser cannot play.

    The tables are rewritten with the new names. keep: keep the old files. Returns the new names.
    Raises UnreadableVideoError, also for an Excel workbook, which holds more than its values.
    """
    with Decoder() as decoder:
        found = list(_unplayable(folder, decoder))
        total = max(1, round(sum(seconds for *_, seconds in found)))
        done = 0.0
        names: list[str] = []
        for table, cell, source, seconds in found:
            target = _free_name(source)
            _transcode(decoder, source, target, partial(_at, report, done, total))
            new_cell = _cell(table, target, folder)
            _rename_in(folder, table, cell, new_cell)
            if not keep:
                source.unlink()
            done += seconds
            names.append(new_cell)
            report(min(total, round(done)), total)
    return names


def _transcode(decoder: Decoder, source: Path, target: Path, at: Callable[[float], None]) -> None:
    try:
        decoder.transcode(source, target, at)
    except UnreadableVideoError as error:
        raise UnreadableVideoError(f"{source.name} cannot be transcoded: {error}") from error


def _at(report: Report, before: float, total: int, now: float) -> None:
    report(min(total, round(before + now)), total)


def _unplayable(folder: Path, decoder: Decoder) -> Iterator[tuple[Path, str, Path, float]]:
    """The tables' videos that some browser cannot play: table, cell, video, seconds."""
    lookup = FileLookup(folder)
    for table in sorted(folder.rglob("*")):
        if table.suffix.lower() not in TABLE_ENDINGS or not is_file(table):
            continue
        try:
            read, column = _file_column(folder, table)
        except (UnreadableFileError, UnmatchedColumnsError):
            continue
        cells = (line.cells[column] for line in read.lines if column < len(line.cells))
        for cell in dict.fromkeys(cells):
            try:
                path = lookup.find(table.parent, cell)
                video = decoder.probe(path)
            except (NoFileError, UnreadableVideoError):
                continue
            if video.hindrance is not None:
                if read.is_workbook:
                    raise UnreadableVideoError(
                        "expected a CSV, to write the names of transcoded videos into, got"
                        f" {table.name}: save it as CSV UTF-8"
                    )
                yield table, cell, path, video.duration_s


def _file_column(folder: Path, path: Path) -> tuple[Table, int]:
    """The table, and its column of files. Raises UnreadableFileError, UnmatchedColumnsError."""
    table = read_table(folder, path, FileLookup(folder).names)
    return table, match(table.header.cells, [line.cells for line in table.lines], []).file


def _free_name(source: Path) -> Path:
    """An unused name beside the source: `a.avi` becomes `a.mp4`, or else `a-h264.mp4`."""
    names = (f"{source.stem}.mp4", f"{source.stem}-h264.mp4")
    for name in (*names, *(f"{source.stem}-h264-{number}.mp4" for number in range(2, 1000))):
        target = source.with_name(name)
        if not target.exists():
            return target
    raise UnreadableVideoError(f"expected a free name beside {source.name}, got none")


def _cell(table: Path, target: Path, folder: Path) -> str:
    """The path of a new file as the table names it: from its own folder, or from the study's."""
    base = table.parent if target.is_relative_to(table.parent) else folder
    return target.relative_to(base).as_posix()


def _rename_in(folder: Path, path: Path, old: str, new: str) -> None:
    """Write the table with another name of a file; dialect and encoding stay."""
    table, column = _file_column(folder, path)
    rows = [list(line.cells) for line in table.lines]
    for row in rows:
        if len(row) > column and row[column] == old:
            row[column] = new
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(written(table, [table.header.cells, *rows]))
    part.replace(path)
