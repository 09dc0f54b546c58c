"""Making videos that every browser plays of those that some cannot: H.264 in MP4, without sound."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream

from app.study.faults import UnreadableFileError
from app.study.files import misplaced, read_text, within
from app.study.recordings import FILE_COLUMN
from app.study.video import VIDEO_FORMATS, UnreadableVideoError, probe

#: Two of them fill a wide screen.
WIDEST_PX = 1280
#: Quality of x264, 0 to 51; at 20 the loss is hardly seen.
_CRF = "20"
_FALLBACK_RATE = 30

#: Told how many seconds of how many are done.
Report = Callable[[int, int], None]


def transcode_folder(folder: Path, report: Report, *, keep: bool) -> list[str]:
    """Transcode every video that a table of the folder names and some browser cannot play.

    The tables name the new files then. keep: whether the old files stay. Returns the new names.
    """
    found = list(_unplayable(folder))
    total = max(1, round(sum(seconds for *_, seconds in found)))
    done = 0.0
    names: list[str] = []
    for table, cell, seconds in found:
        source = table.parent / cell
        target = _free_name(source)
        transcode(source, target, partial(_at, report, done, total))
        new_cell = Path(cell).with_name(target.name).as_posix()
        _rename_in(folder, table, cell, new_cell)
        if not keep:
            source.unlink()
        done += seconds
        names.append(new_cell)
        report(min(total, round(done)), total)
    return names


def _at(report: Report, before: float, total: int, now: float) -> None:
    report(min(total, round(before + now)), total)


def transcode(
    source: Path, target: Path, at: Callable[[float], None] = lambda _seconds: None
) -> None:
    """Write `source` as H.264, yuv420p, upright, at most 1280 pixels wide, index first, no sound.

    `at` is told how many seconds are done. The target appears whole or not at all. Raises
    UnreadableVideoError.
    """
    part = target.with_name(f".{target.name}.part")
    try:
        with (
            source.open("rb") as content,
            av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as given,
            av.open(part, mode="w", format="mp4", options={"movflags": "+faststart"}) as written,
        ):
            _write(given.streams.video[0], given.decode(video=0), written, at)
        part.replace(target)
    except (av.FFmpegError, OSError, ValueError, IndexError) as error:
        raise UnreadableVideoError(f"{source.name} cannot be transcoded: {error}") from error
    finally:
        part.unlink(missing_ok=True)


def _write(
    given: VideoStream,
    frames: Iterator[av.VideoFrame],
    written: av.container.OutputContainer,
    at: Callable[[float], None],
) -> None:
    out: VideoStream | None = None
    rate = given.average_rate or Fraction(_FALLBACK_RATE)
    for frame in frames:
        upright = _upright(frame)
        if out is None:
            wide = upright.width * float(given.sample_aspect_ratio or 1)
            scale = min(1.0, WIDEST_PX / wide)
            out = written.add_stream("libx264", rate=rate)
            # H.264 halves its colours: both sides have to be even.
            out.width = max(2, round(wide * scale / 2) * 2)
            out.height = max(2, round(upright.height * scale / 2) * 2)
            out.pix_fmt = "yuv420p"
            out.options = {"crf": _CRF, "preset": "medium"}
            if frame.time_base is not None:
                out.codec_context.time_base = frame.time_base
        shown = upright.reformat(out.width, out.height, "yuv420p")
        shown.pts, shown.time_base = frame.pts, frame.time_base
        shown.pict_type = 0
        written.mux(out.encode(shown))
        at(frame.time or 0.0)
    if out is not None:
        written.mux(out.encode())


def _upright(frame: av.VideoFrame) -> av.VideoFrame:
    """A phone held upright stores its pictures lying, and says by how much they are turned."""
    quarters = round(frame.rotation / 90) % 4
    if quarters == 0:
        return frame
    turned = np.rot90(frame.to_ndarray(format="rgb24"), k=quarters)
    return av.VideoFrame.from_ndarray(np.ascontiguousarray(turned, np.uint8), format="rgb24")


def _unplayable(folder: Path) -> Iterator[tuple[Path, str, float]]:
    """The tables' videos that some browser cannot play: table, cell, seconds."""
    for table in sorted(folder.rglob("*.csv")):
        try:
            rows = list(csv.DictReader(io.StringIO(read_text(folder, table), newline="")))
        except (UnreadableFileError, csv.Error):
            continue
        for cell in dict.fromkeys((row.get(FILE_COLUMN) or "").strip() for row in rows):
            path = table.parent / cell
            if misplaced(cell) is not None or not path.is_file() or not within(folder, path):
                continue
            try:
                video = probe(path)
            except UnreadableVideoError:
                continue
            if video.hindrance is not None:
                yield table, cell, video.duration_s


def _free_name(source: Path) -> Path:
    """A name beside the source that nothing has: `a.avi` becomes `a.mp4`, or else `a-h264.mp4`."""
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
