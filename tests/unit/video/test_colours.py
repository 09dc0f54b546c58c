"""Transcoded videos keep the colours that were recorded, and say which they are."""

from __future__ import annotations

import io
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange
from PIL import Image

from app.video.encoding import transcode
from app.video.probing import probe
from app.video.stills import still
from app.video.video_info import UnreadableVideoError
from tests.unit.video.test_remuxing import turn

SIZE = (128, 64)
PQ, HLG, BT2020 = 16, 18, 9
#: Saturated colours show a wrong matrix, which greys do not.
PATCHES = ((200, 40, 40), (40, 180, 60), (50, 60, 210), (220, 200, 40))


def write(
    path: Path,
    frame: av.VideoFrame,
    *,
    codec: str = "ffv1",
    matrix: int = 2,
    transfer: int = 2,
    primaries: int = 2,
) -> Path:
    with av.open(path, "w") as container:
        stream = container.add_stream(codec, rate=10)
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, frame.format.name
        context = stream.codec_context
        context.color_range = frame.color_range
        context.colorspace, context.color_trc = matrix, transfer
        context.color_primaries = primaries
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def patches() -> av.VideoFrame:
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for number, colour in enumerate(PATCHES):
        picture[:, 32 * number : 32 * (number + 1)] = colour
    return av.VideoFrame.from_ndarray(picture, format="rgb24")


def shown(path: Path) -> np.ndarray:
    """The first picture in RGB, decoded by what the file says of itself."""
    with av.open(path) as container:
        return next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)


def said(path: Path) -> tuple[int, int, int, int]:
    with av.open(path) as container:
        frame = next(container.decode(video=0))
        return frame.color_range, frame.colorspace, frame.color_primaries, frame.color_trc


def apart(path: Path) -> int:
    found = shown(path)[32, 16::32]
    return int(np.abs(found - np.array(PATCHES)).max())


@pytest.mark.parametrize("matrix", [1, 5, 7, 9])
@pytest.mark.parametrize("full", [False, True])
def test_range_and_matrix_of_a_recording_are_kept_and_said(
    tmp_path: Path, matrix: int, full: bool
) -> None:
    frame = patches().reformat(
        format="yuv444p",
        dst_colorspace=matrix,
        dst_color_range=ColorRange.JPEG if full else ColorRange.MPEG,
    )
    source = write(tmp_path / "a.mkv", frame, matrix=matrix)
    assert apart(source) <= 3
    transcode(source, tmp_path / "a.mp4")
    assert apart(tmp_path / "a.mp4") <= 4
    assert said(tmp_path / "a.mp4")[:2] == (ColorRange.MPEG, matrix)


def test_pictures_in_rgb_become_bt709_and_say_so(tmp_path: Path) -> None:
    transcode(write(tmp_path / "a.mkv", patches().reformat(format="bgr0")), tmp_path / "a.mp4")
    assert apart(tmp_path / "a.mp4") <= 4
    assert said(tmp_path / "a.mp4") == (ColorRange.MPEG, 1, 1, 1)


def test_a_small_picture_made_of_a_large_one_keeps_the_large_ones_matrix(tmp_path: Path) -> None:
    """A browser guesses the matrix by the height, which transcoding changes."""
    frame = patches().reformat(1920, 800, "yuv420p", dst_colorspace=1)
    source = write(tmp_path / "a.mkv", frame)
    transcode(source, tmp_path / "a.mp4")
    assert probe(tmp_path / "a.mp4").height < 720
    assert said(tmp_path / "a.mp4")[1] == 1
    found = shown(tmp_path / "a.mp4")[266, 160::320]
    assert np.abs(found - np.array(PATCHES)).max() <= 4


def hdr_greys(values: list[float]) -> av.VideoFrame:
    """Bars of 10-bit greys of limited range."""
    frame = av.VideoFrame(32 * len(values), 64, "yuv420p10le")
    luma = np.repeat([round(4 * (16 + 219 * value)) for value in values], 32)
    for plane, row in zip(frame.planes, (luma, *[np.full(len(luma) // 2, 512)] * 2), strict=True):
        rows = np.zeros((plane.height, plane.line_size // 2), np.uint16)
        rows[:, : len(row)] = row
        plane.update(rows.tobytes())
    frame.color_range, frame.colorspace = ColorRange.MPEG, BT2020
    frame.color_trc = frame.color_primaries = 2
    return frame


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_a_high_dynamic_range_is_named(tmp_path: Path, transfer: int) -> None:
    source = write(
        tmp_path / "a.mkv", hdr_greys([0, 1]), matrix=BT2020, transfer=transfer, primaries=BT2020
    )
    assert "high dynamic range (HDR)" in str(probe(source).hindrance)


@pytest.mark.long
def test_a_high_dynamic_range_is_tone_mapped(tmp_path: Path) -> None:
    greys = hdr_greys([0, 0.1, 0.25, 0.38, 0.75, 0.85, 1])
    source = write(tmp_path / "a.mkv", greys, matrix=BT2020, transfer=HLG, primaries=BT2020)
    transcode(source, tmp_path / "a.mp4")
    assert said(tmp_path / "a.mp4") == (ColorRange.MPEG, 1, 1, 1)
    assert probe(tmp_path / "a.mp4").hindrance is None
    found = shown(tmp_path / "a.mp4")[32, 16::32]
    assert np.ptp(found, axis=1).max() <= 2
    shades = found.mean(axis=1)
    # All stay apart, those above the white of paper (0.75) too, and none is washed out.
    assert (np.diff(shades) >= 8).all()
    assert shades[0] <= 3
    assert 125 <= shades[4] <= 200


def test_colours_that_cannot_be_converted_are_refused_in_a_sentence(tmp_path: Path) -> None:
    frame = hdr_greys([0, 0.5, 1, 0])
    frame.colorspace = 14
    source = write(tmp_path / "a.mkv", frame, matrix=14, transfer=PQ, primaries=BT2020)
    with pytest.raises(UnreadableVideoError, match="its colours have the matrix 14"):
        transcode(source, tmp_path / "a.mp4")


def test_h264_without_colours_is_transcoded_since_not_every_browser_plays_it(
    tmp_path: Path,
) -> None:
    grey = patches().reformat(format="gray")
    source = write(tmp_path / "a.mp4", grey, codec="libx264")
    assert "pixel format gray" in str(probe(source).hindrance)
    transcode(source, tmp_path / "new.mp4")
    found = shown(tmp_path / "new.mp4")[32, 16::32, 0]
    assert np.abs(found - grey.to_ndarray()[32, 16::32].astype(int)).max() <= 2


def test_the_still_of_a_recording_has_its_colours(tmp_path: Path) -> None:
    frame = patches().reformat(format="yuvj420p", dst_colorspace=1, dst_color_range=ColorRange.JPEG)
    source = write(tmp_path / "a.mp4", frame, codec="libx264", matrix=1)
    picture = np.array(Image.open(io.BytesIO(still(source)))).astype(int)
    assert np.abs(picture[32, 16::32] - np.array(PATCHES)).max() <= 6


def test_a_recording_of_a_phone_held_upright_is_turned_in_its_colours(tmp_path: Path) -> None:
    frame = patches().reformat(format="yuvj420p", dst_colorspace=1, dst_color_range=ColorRange.JPEG)
    source = write(tmp_path / "a.mp4", frame, codec="libx264", matrix=1)
    turn(source)
    transcode(source, tmp_path / "new.mp4")
    made = probe(tmp_path / "new.mp4")
    assert (made.width, made.height) == (SIZE[1], SIZE[0])
    found = shown(tmp_path / "new.mp4")[16::32, 32]
    assert min(np.abs(found - np.array(PATCHES)[::way]).max() for way in (1, -1)) <= 4
