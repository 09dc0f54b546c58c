"""Making a video that every browser plays: H.264 in MP4, without sound."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
from av.container import OutputContainer
from av.video.stream import VideoStream

from .limits import threads
from .upright import UprightPictures
from .video_info import VIDEO_FORMATS, UnreadableVideoError, part_of

#: Two of them fill a wide screen.
WIDEST_PX = 1280
#: Quality of x264, 0 to 51; at 20 the loss is hardly seen.
_CRF = "20"
_FALLBACK_RATE = 30


def transcode(
    source: Path, target: Path, at: Callable[[float], None] = lambda _seconds: None
) -> None:
    """Write `source` as H.264, yuv420p, upright, at most 1280 pixels wide, index first, no sound.

    Its colours stay as they were recorded, and are named in the file; a high dynamic range is
    tone-mapped to the ordinary one. `at` is told how many seconds are done. The target appears
    whole or not at all. Raises UnreadableVideoError, and MemoryError where the process may take no
    more of it.
    """
    part = part_of(target)
    try:
        with (
            source.open("rb") as content,
            av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as given,
            av.open(part, mode="w", format="mp4", options={"movflags": "+faststart"}) as written,
        ):
            _write(given.streams.video[0], given.decode(video=0), written, at)
        part.replace(target)
    except MemoryError:
        raise
    except (av.FFmpegError, OSError, ValueError, IndexError) as error:
        raise UnreadableVideoError(str(error)) from error
    finally:
        part.unlink(missing_ok=True)


def _write(
    given: VideoStream,
    frames: Iterator[av.VideoFrame],
    written: OutputContainer,
    at: Callable[[float], None],
) -> None:
    out: VideoStream | None = None
    pictures: UprightPictures | None = None
    rate = given.average_rate or Fraction(_FALLBACK_RATE)
    for frame in frames:
        if out is None or pictures is None:
            pictures = UprightPictures(frame, given, WIDEST_PX)
            out = written.add_stream("libx264", rate=rate)
            out.width, out.height, out.pix_fmt = pictures.width, pictures.height, "yuv420p"
            out.codec_context.thread_count = threads()
            out.options = {"crf": _CRF, "preset": "medium"}
            pictures.tag(out.codec_context)
            if frame.time_base is not None:
                out.codec_context.time_base = frame.time_base
        shown = pictures.convert(frame)
        shown.pict_type = 0
        written.mux(out.encode(shown))
        at(frame.time or 0.0)
    if out is not None:
        written.mux(out.encode())
