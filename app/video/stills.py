"""A still picture of a video."""

from __future__ import annotations

import io
from pathlib import Path

import av
from PIL import Image

from .upright import UprightPictures
from .video_info import VIDEO_FORMATS, UnreadableVideoError

#: Longest side, in pixels.
_SIZE_PX = 640


def still(path: Path) -> bytes:
    """The frame in the middle of a video, as JPEG. Raises UnreadableVideoError, MemoryError."""
    try:
        with (
            path.open("rb") as content,
            av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as container,
        ):
            stream = container.streams.video[0]
            middle = stream.frames // 2
            shown = None
            for index, frame in enumerate(container.decode(stream)):
                shown = frame
                if index == middle:
                    break
            if shown is None:
                raise UnreadableVideoError("it has no frame")
            upright = UprightPictures(shown, stream, _SIZE_PX).convert(shown)
            picture: Image.Image = upright.to_image()  # type: ignore[no-untyped-call]
    except MemoryError:
        raise
    except (av.FFmpegError, OSError, ValueError, IndexError) as error:
        raise UnreadableVideoError(str(error)) from error
    picture.thumbnail((_SIZE_PX, _SIZE_PX))
    sink = io.BytesIO()
    picture.save(sink, "JPEG", quality=80)
    return sink.getvalue()
