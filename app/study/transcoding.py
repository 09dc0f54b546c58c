"""Transcodes videos in a study's folder that some browsers cannot play."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from .files import is_file, misplaced, read_text, within
from .recordings import FILE_COLUMN
from .validation_errors import UnreadableFileError

#: Callback with the seconds done and the seconds in total.
Report = Callable[[int, int], None]


def transcode_folder(folder: Path, report: Report, *, keep: bool) -> list[str]:
    """Transcode every video listed in the folder's tables that some browser cannot play.

    The tables are rewritten with the new names. keep: keep the old files. Returns the new names.
    """
    with Decoder() as decoder:
        found = list(_unplayable(folder, decoder))
        total = max(1, round(sum(seconds for *_, seconds in found)))
        done = 0.0
        names: list[str] = []
        for table, cell, seconds in found:
            source = table.parent / cell
            target = _free_name(source)
            _transcode(decoder, source, target, partial(_at, report, done, total))
            new_cell = Path(cell).with_name(target.name).as_posix()
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


def _unplayable(folder: Path, decoder: Decoder) -> Iterator[tuple[Path, str, float]]:
    """The tables' videos that some browser cannot play: table, cell, seconds."""
    for table in sorted(folder.rglob("*.csv")):
        try:
            rows = list(csv.DictReader(io.StringIO(read_text(folder, table), newline="")))
        except (UnreadableFileError, csv.Error):
            continue
        for cell in dict.fromkeys((row.get(FILE_COLUMN) or "").strip() for row in rows):
            path = table.parent / cell
            if misplaced(cell) is not None or not is_file(path) or not within(folder, path):
                continue
            try:
                video = decoder.probe(path)
            except UnreadableVideoError:
                continue
            if video.hindrance is not None:
                yield table, cell, video.duration_s


def _free_name(source: Path) -> Path:
    """An unused name beside the source: `a.avi` becomes `a.mp4`, or else `a-h264.mp4`."""
    names = (f"{source.stem}.mp4", f"{source.stem}-h264.mp4")
    for name in (*names, *(f"{source.stem}-h264-{number}.mp4" for number in range(2, 1000))):
        target = source.with_name(name)
        if not target.exists():
            return target
    raise UnreadableVideoError(f"expected a free name beside {source.name}, got none")


def _rename_in(folder: Path, table: Path, old: str, new: str) -> None:
    text = read_text(folder, table)
    rows = list(csv.reader(io.StringIO(text, newline="")))
    header = [name.strip() for name in rows[0]]
    column = header.index(FILE_COLUMN)
    for row in rows[1:]:
        if len(row) > column and row[column].strip() == old:
            row[column] = new
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows(rows)
    part = table.with_name(f".{table.name}.part")
    part.write_text(written.getvalue(), encoding="utf-8")
    part.replace(table)
