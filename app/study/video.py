"""Looking into a video file: can it be played, and how long is it."""

from dataclasses import dataclass
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

# FFmpeg otherwise guesses from the content: a playlist, which could make it fetch other files and
# addresses, or a still picture and even a plain text, would pass for a video.
VIDEO_FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,ogg,avi,mpegts,mpeg"


class UnreadableVideoError(Exception):
    """The file is no video that can be decoded; the message says what came of trying."""


@dataclass(frozen=True)
class Video:
    """What a first look at a video gave."""

    duration_s: float


def probe(path: Path) -> Video:
    """Opens the video, decodes its first frame and finds its length."""
    try:
        # An open file rather than a name: FFmpeg then has no folder to look for other files in.
        with (
            path.open("rb") as content,
            av.open(content, mode="r", options={"format_whitelist": VIDEO_FORMATS}) as container,
        ):
            if not container.streams.video:
                raise UnreadableVideoError("it has no picture")
            stream = container.streams.video[0]
            if next(container.decode(stream), None) is None:
                raise UnreadableVideoError("it has no frame")
            duration_s = _stated_duration_s(container, stream)
            if duration_s is None:
                duration_s = _measured_duration_s(container, stream)
    except (av.ArgumentError, av.InvalidDataError) as error:
        # FFmpeg's "invalid argument" is its refusal of a form that is not in the list above.
        reason = "it is no MP4, WebM, Ogg, AVI or MPEG video, or a damaged one"
        raise UnreadableVideoError(reason) from error
    except (av.FFmpegError, OSError, ValueError) as error:
        raise UnreadableVideoError(str(error)) from error
    if duration_s <= 0:
        raise UnreadableVideoError("it lasts no time")
    return Video(duration_s)


def _stated_duration_s(container: InputContainer, stream: VideoStream) -> float | None:
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    if container.duration is not None:
        return container.duration / av.time_base
    return None


def _measured_duration_s(container: InputContainer, stream: VideoStream) -> float:
    """Some recorders (a browser's among them) leave the length out: take the last packet's end."""
    container.seek(0)
    ends = [
        float((packet.pts + (packet.duration or 0)) * packet.time_base)
        for packet in container.demux(stream)
        if packet.pts is not None and packet.time_base is not None
    ]
    return max(ends, default=0.0)
