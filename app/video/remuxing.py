"""Copying a video's pictures into a new file without what else its file holds.

Encoders write titles, dates, places and names of files into a video. A stream copy leaves the
compressed pictures, their times, colours and rotation as they are; the container is written anew,
with none of that, and without sound, captions and data.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av

from .probing import container_of
from .video_info import VIDEO_FORMATS, UnreadableVideoError, part_of

#: No name of a program, no time and no random number is written; an MP4's index comes first.
_OPTIONS = {
    "mp4": {"fflags": "+bitexact", "movflags": "+faststart"},
    "webm": {"fflags": "+bitexact"},
}


def remux(source: Path, target: Path) -> str:
    """Write the pictures of `source` to `target`; the form of both, mp4 or webm.

    The target appears whole or not at all. Raises UnreadableVideoError, also where a picture or its
    time would not be what it was, and MemoryError.
    """
    part = part_of(target)
    try:
        form = _copy(source, part)
        if list(_pictures(source)) != list(_pictures(part)):
            raise UnreadableVideoError("its pictures cannot be copied as they are")
        part.replace(target)
    except MemoryError:
        raise
    except (av.FFmpegError, OSError, ValueError, IndexError) as error:
        raise UnreadableVideoError(str(error)) from error
    finally:
        part.unlink(missing_ok=True)
    return form


def _copy(source: Path, part: Path) -> str:
    with (
        source.open("rb") as content,
        av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as given,
    ):
        form = container_of(given, source)
        if form not in _OPTIONS:
            raise UnreadableVideoError(f"expected MP4 or WebM, got a file of the form {form}")
        stream = given.streams.video[0]
        with av.open(part, mode="w", format=form, options=_OPTIONS[form]) as written:
            # Opaque: by the codec's number, since not every codec can be encoded here.
            out = written.add_stream_from_template(stream, opaque=True)
            if stream.time_base is not None:
                out.time_base = stream.time_base
            for packet in given.demux(stream):
                if packet.size:
                    packet.stream = out
                    written.mux(packet)
    return form


def _pictures(path: Path) -> Iterator[tuple[bytes, Fraction | None, bool]]:
    """Each compressed picture: its bytes, its time from the first, and whether it is skipped."""
    with (
        path.open("rb") as content,
        av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as container,
    ):
        first: Fraction | None = None
        for packet in container.demux(container.streams.video[0]):
            if not packet.size:
                continue
            time = None
            if packet.pts is not None and packet.time_base is not None:
                time = packet.pts * packet.time_base
                first = time if first is None else first
                time -= first
            yield hashlib.sha256(bytes(packet)).digest(), time, packet.is_discard
