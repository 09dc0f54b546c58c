"""Making a video that every browser plays: H.264 in MP4, without sound."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
from av.container import OutputContainer
from av.video.stream import VideoStream

from .limits import threads
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

    `at` is told how many seconds are done. The target appears whole or not at all. Raises
    UnreadableVideoError, and MemoryError where the process may take no more of it.
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
            out.codec_context.thread_count = threads()
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
    # Needed for such videos alone, and takes longer to import than to turn one.
    import numpy as np  # noqa: PLC0415

    turned = np.rot90(frame.to_ndarray(format="rgb24"), k=quarters)
    return av.VideoFrame.from_ndarray(np.ascontiguousarray(turned, np.uint8), format="rgb24")
