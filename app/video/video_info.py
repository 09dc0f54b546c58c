"""What is known of a video once it was looked into, and what browsers make of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# FFmpeg otherwise guesses from the content: a playlist, which could make it fetch other files and
# addresses, or a still picture and even a plain text, would pass for a video.
VIDEO_FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,ogg,avi,mpegts,mpeg"

#: What every current browser plays: container -> codec -> pixel formats.
_MP4 = {"h264": ("yuv420p", "yuvj420p"), "av1": ("yuv420p",), "vp9": ("yuv420p",)}
_WEBM = {"vp8": ("yuv420p",), "vp9": ("yuv420p",), "av1": ("yuv420p",)}
#: FFmpeg reads MP4 and its kin by one reader, WebM and Matroska by another.
_PLAYED: Mapping[str, Mapping[str, Sequence[str]]] = {"mp4": _MP4, "webm": _WEBM}
#: More pixels along a side than a page gives to one of two videos.
LARGE_PX = 1920


class UnreadableVideoError(Exception):
    """The file is no video that can be decoded; the message says what came of trying."""


class DecoderFailedError(UnreadableVideoError):
    """The process that looked into the video died, or took more than it may."""


class NotTriedError(UnreadableVideoError):
    """Nobody looked into the video, since the decoder failed on too many before it."""


@dataclass(frozen=True)
class Video:
    """What looking into a video gave."""

    duration_s: float
    codec: str = ""
    pixel_format: str = ""
    container: str = ""
    width: int = 0
    height: int = 0
    has_audio: bool = False
    starts_fast: bool = True
    is_hdr: bool = False

    @property
    def hindrance(self) -> str | None:
        """What keeps some browser from playing it as it is; None where every one does."""
        if self.is_hdr:
            form = self._unplayed_form or f"{self.codec} in {self.container}"
            return f"{form}, with a high dynamic range (HDR), which browsers show differently"
        return self._unplayed_form

    @property
    def _unplayed_form(self) -> str | None:
        codecs = _PLAYED.get(self.container)
        if codecs is None:
            return f"a file of the form {self.container}"
        if self.codec not in codecs:
            return f"{self.codec} in {self.container}"
        if self.pixel_format not in codecs[self.codec]:
            return f"{self.codec} with the pixel format {self.pixel_format}"
        return None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What does no harm, and is worth knowing."""
        found = []
        if not self.starts_fast:
            found.append("its index lies at its end: it starts late on a slow line")
        if self.has_audio:
            found.append("it has sound, which is not played")
        if max(self.width, self.height) > LARGE_PX:
            found.append(f"it is {self.width} x {self.height} pixels: larger than a page shows it")
        return tuple(found)


def part_of(target: Path) -> Path:
    """The file in which a video is written until it is whole."""
    return target.with_name(f".{target.name}.part")
