"""Decoded pictures as they are to be seen: upright, with square pixels, in tagged colours."""

from __future__ import annotations

import av
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from .colours import ColourConverter, colours_of


class UprightPictures:
    """Turns the pictures of one video into 8-bit 4:2:0, upright and no wider than they may be."""

    def __init__(self, first: av.VideoFrame, stream: VideoStream, widest_px: int) -> None:
        """first: the first picture of `stream`. Raises UnreadableVideoError."""
        # A phone held upright stores its pictures lying, and says by how much they are turned.
        self._quarters = round(first.rotation / 90) % 4
        wide = first.width * float(stream.sample_aspect_ratio or 1)
        is_on_its_side = self._quarters % 2 == 1
        scale = min(1.0, widest_px / (first.height if is_on_its_side else wide))
        # 4:2:0 halves its colours: both sides are even.
        size = (_even(wide * scale), _even(first.height * scale))
        self._converter = ColourConverter(colours_of(first, stream.codec_context), *size)
        self.width, self.height = reversed(size) if is_on_its_side else size

    def tag(self, context: VideoCodecContext) -> None:
        """Write into an encoder's context what the colours are."""
        self._converter.tag(context)

    def convert(self, frame: av.VideoFrame) -> av.VideoFrame:
        """`frame` as it is to be seen, at its time."""
        shown = self._converter.convert(frame)
        if self._quarters:
            shown = _turned(shown, self._quarters)
        shown.pts, shown.time_base = frame.pts, frame.time_base
        return shown


def _even(pixels: float) -> int:
    return max(2, round(pixels / 2) * 2)


def _turned(frame: av.VideoFrame, quarters: int) -> av.VideoFrame:
    """A 4:2:0 picture turned anticlockwise by so many quarters of a circle."""
    # Needed for such videos alone, and takes longer to import than to turn one.
    import numpy as np  # noqa: PLC0415

    width, height = frame.width, frame.height
    numbers = frame.to_ndarray().reshape(-1)
    luma, chroma = width * height, width * height // 4
    planes = (
        numbers[:luma].reshape(height, width),
        numbers[luma : luma + chroma].reshape(height // 2, width // 2),
        numbers[luma + chroma :].reshape(height // 2, width // 2),
    )
    flat = np.concatenate([np.rot90(plane, k=quarters).reshape(-1) for plane in planes])
    shown = av.VideoFrame.from_ndarray(
        flat.reshape(-1, height if quarters % 2 else width), format="yuv420p"
    )
    shown.colorspace, shown.color_range = frame.colorspace, frame.color_range
    return shown
