"""Copies of videos without metadata: the same pictures, and nothing else that the file held."""

from __future__ import annotations

import hashlib
import math
import struct
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from app.video.decoder_client import Decoder
from app.video.remuxing import remux
from app.video.video_info import UnreadableVideoError

SECRETS = {
    "title": "SECRET-title speed=0.1",
    "comment": "SECRET-comment",
    "location": "+60.1700+024.9400/",
    "creation_time": "2024-01-02T03:04:05Z",
    "artist": "SECRET-artist",
}
TOLD = (b"SECRET", b"+60.17", b"2024", b"Lavf6", b"SECRET-handler")
BT709, FULL_RANGE = 1, 2


def write(path: Path, codec: str = "libx264", *, sound: bool = False, moving: int = 24) -> Path:
    """A video with secrets wherever a file has room for them; `moving` frames with B-frames."""
    with av.open(path, mode="w") as container:
        container.metadata.update(SECRETS)
        stream: Any = container.add_stream(codec, rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.metadata.update({"handler_name": "SECRET-handler", "title": "SECRET-stream"})
        context: Any = stream.codec_context
        context.color_range, context.colorspace = FULL_RANGE, BT709
        context.color_primaries = context.color_trc = BT709
        if sound:
            noise = container.add_stream("aac", rate=48000)
        for number in range(moving):
            shade = np.full((48, 64, 3), number * 9 % 256, np.uint8)
            shade[:, : number * 2] = 255 - shade[:, : number * 2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shade, format="rgb24")))
        container.mux(stream.encode())
        if sound:
            heard = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
            heard.sample_rate = 48000
            container.mux(noise.encode(heard))
            container.mux(noise.encode())
    return path


def turn(path: Path) -> None:
    """Say in the file that its pictures are to be turned by 90 degrees, as a phone does."""
    content = bytearray(path.read_bytes())
    # ISO/IEC 14496-12, 8.3.2: the matrix of the track's header, version 0, in 16.16 and 2.30.
    place = content.index(b"tkhd") + 4 + 40
    turned = (0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30)
    content[place : place + 36] = struct.pack(">9i", *turned)
    path.write_bytes(content)


def pictures(path: Path) -> list[tuple[Any, ...]]:
    with av.open(path) as container:
        return [
            (
                frame.time,
                frame.rotation,
                *(frame.width, frame.height, frame.format.name),
                *(frame.color_range, frame.colorspace),
                hashlib.sha256(frame.to_ndarray().tobytes()).hexdigest(),
            )
            for frame in container.decode(video=0)
        ]


@pytest.mark.parametrize(
    ("name", "codec", "form"),
    [
        ("a.mp4", "libx264", "mp4"),
        ("a.mov", "libx264", "mp4"),
        ("a.mp4", "libvpx-vp9", "mp4"),
        ("a.webm", "libvpx", "webm"),
        ("a.webm", "libvpx-vp9", "webm"),
    ],
)
def test_nothing_but_the_pictures_is_copied_and_they_are_the_same(
    tmp_path: Path, name: str, codec: str, form: str
) -> None:
    source = write(tmp_path / name, codec)
    assert b"SECRET" in source.read_bytes()
    before = source.read_bytes()
    assert remux(source, tmp_path / "copy") == form
    copied = (tmp_path / "copy").read_bytes()
    assert [told for told in TOLD if told in copied] == []
    assert pictures(tmp_path / "copy") == pictures(source)
    assert source.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "copy"])


def test_rotation_and_colours_stay(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mp4")
    turn(source)
    (first, *_) = pictures(source)
    assert abs(first[1]) == 90
    assert (first[5], first[6]) == (FULL_RANGE, BT709)
    remux(source, tmp_path / "copy")
    assert pictures(tmp_path / "copy") == pictures(source)
    with av.open(source) as one, av.open(tmp_path / "copy") as other:
        for name in ("color_range", "colorspace", "color_primaries", "color_trc"):
            kept = [getattr(file.streams.video[0].codec_context, name) for file in (one, other)]
            assert kept[0] == kept[1], name
        lengths = [float(file.duration or 0) / av.time_base for file in (one, other)]
        assert math.isclose(*lengths, abs_tol=0.05)


def test_sound_is_left_out(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mp4", sound=True)
    remux(source, tmp_path / "copy")
    with av.open(tmp_path / "copy") as copied:
        assert [stream.type for stream in copied.streams] == ["video"]
    assert pictures(tmp_path / "copy") == pictures(source)


def test_the_same_video_gives_the_same_bytes(tmp_path: Path) -> None:
    source = write(tmp_path / "a.webm", "libvpx")
    for name in ("one", "two"):
        remux(source, tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_name_that_says_another_form_does_not_count(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mp4").rename(tmp_path / "a.webm")
    with Decoder() as decoder:
        assert decoder.remux(source, tmp_path / "copy") == "mp4"


def test_what_is_no_video_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    source = tmp_path / "a.mp4"
    source.write_bytes(b"no video at all" * 100)
    with Decoder() as decoder, pytest.raises(UnreadableVideoError):
        decoder.remux(source, tmp_path / "copy")
    assert list(tmp_path.iterdir()) == [source]
