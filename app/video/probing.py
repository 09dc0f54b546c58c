"""Looking into a video file: what form it has, how long it is, whether it is whole."""

from __future__ import annotations

import struct
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from .colours import HDR_TRANSFERS, is_monochrome
from .limits import threads
from .video_info import VIDEO_FORMATS, UnreadableVideoError, Video

#: A larger picture or a longer video is a slip, or meant to use the memory and the time up.
MOST_PIXELS = 50_000_000
LONGEST_S = 3600.0
_WEBM_MARK = b"webm"
#: So much of a video may be missing at its end, by what its header says, before it counts as cut.
_CUT_FROM_S = 0.5
#: The first bytes in which a WebM file says that it is one.
_HEAD_BYTES = 4096


def probe(path: Path) -> Video:
    """Opens the video, decodes all of it, and finds its length. Raises UnreadableVideoError.

    Raises MemoryError where the process may take no more of it.
    """
    try:
        # An open file rather than a name: FFmpeg then has no folder to look for other files in.
        with (
            path.open("rb") as content,
            av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as container,
        ):
            if not container.streams.video:
                raise UnreadableVideoError("it has no picture")
            stream = container.streams.video[0]
            stated_s = _stated_duration_s(container, stream)
            _require_limits(stream, stated_s)
            first, end_s = _decoded(container, stream)
            duration_s = end_s if stated_s is None else stated_s
            video = Video(
                duration_s=duration_s,
                codec=stream.codec_context.name.removeprefix("lib").replace("dav1d", "av1"),
                pixel_format=_pixel_format(first, stream),
                is_hdr=first.color_trc in HDR_TRANSFERS,
                container=container_of(container, path),
                width=first.width,
                height=first.height,
                has_audio=bool(container.streams.audio),
                starts_fast=_starts_fast(path),
            )
    except (av.ArgumentError, av.InvalidDataError) as error:
        # FFmpeg's "invalid argument" is its refusal of a form that is not in the list above.
        reason = "it is no MP4, WebM, Ogg, AVI or MPEG video, or a damaged one"
        raise UnreadableVideoError(reason) from error
    except MemoryError:
        # It says something of the process, and not of the video.
        raise
    except (av.FFmpegError, OSError, ValueError) as error:
        raise UnreadableVideoError(str(error)) from error
    if duration_s <= 0:
        raise UnreadableVideoError("it lasts no time")
    if duration_s - end_s > _CUT_FROM_S:
        raise UnreadableVideoError(
            f"it says that it lasts {duration_s:.1f} s and ends after {end_s:.1f} s: it is cut off"
        )
    return video


def _pixel_format(first: av.VideoFrame, stream: VideoStream) -> str:
    return "gray" if is_monochrome(stream.codec_context) else first.format.name


def _require_limits(stream: VideoStream, stated_s: float | None) -> None:
    pixels = stream.codec_context.width * stream.codec_context.height
    if pixels > MOST_PIXELS:
        raise UnreadableVideoError(f"its pictures have {pixels / 1e6:,.0f} million pixels")
    if stated_s is not None and stated_s > LONGEST_S:
        raise UnreadableVideoError(f"it lasts {stated_s / 60:,.0f} minutes, longer than an hour")


def _decoded(container: InputContainer, stream: VideoStream) -> tuple[av.VideoFrame, float]:
    """The first frame, and where the last one ends, in seconds from the first."""
    stream.thread_type = "AUTO"
    stream.codec_context.thread_count = threads()
    first = last = None
    try:
        for frame in container.decode(stream):
            first = first or frame
            last = frame
    except av.InvalidDataError as error:
        if first is None or last is None:
            raise
        at = f"{(last.time or 0.0):.1f} s"
        raise UnreadableVideoError(f"it is damaged after {at}") from error
    if first is None or last is None:
        raise UnreadableVideoError("it has no frame")
    if first.time is None or last.time is None:
        return first, 0.0
    length = last.duration or 0
    time_base = last.time_base or 0
    return first, last.time - first.time + float(length * time_base)


def _stated_duration_s(container: InputContainer, stream: VideoStream) -> float | None:
    """What the file says; some recorders (a browser's among them) leave the length out."""
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    if container.duration is not None and container.duration > 0:
        return container.duration / av.time_base
    return None


def container_of(container: InputContainer, path: Path) -> str:
    """The form of an open file, whatever its name says."""
    names = container.format.name.split(",")
    if "mp4" in names:
        return "mp4"
    if "webm" in names:
        # One reader for both; only the file itself says which it is.
        with path.open("rb") as content:
            return "webm" if _WEBM_MARK in content.read(_HEAD_BYTES) else "matroska"
    return names[0]


def _starts_fast(path: Path) -> bool:
    """Whether an MP4's index (moov) comes before its pictures (mdat); other forms have none.

    Boxes of ISO/IEC 14496-12, 4.2: a size of 32 bits and a name; size 1 is followed by 64 bits.
    """
    with path.open("rb") as content:
        while len(head := content.read(8)) == 8:
            size, name = struct.unpack(">I4s", head)
            if name in (b"moov", b"moof"):
                return True
            if name == b"mdat":
                return False
            skip = size - 8
            if size == 1:
                skip = struct.unpack(">Q", content.read(8).ljust(8, b"\0"))[0] - 16
            if skip < 0:
                return True
            content.seek(skip, 1)
    return True
