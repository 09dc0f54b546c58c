"""What is found in a video, and what becomes of one that some browser cannot play."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.study.folder import load
from app.study.transcoding import transcode_folder
from app.study.validation_errors import StudyFaults
from app.video.encoding import transcode
from app.video.probing import probe
from app.video.video_info import UnreadableVideoError
from tests.videos import FRAMES, write

PLAYED = [
    ("a.mp4", "libx264", "yuv420p"),
    ("a.webm", "libvpx", "yuv420p"),
    ("a.webm", "libvpx-vp9", "yuv420p"),
]
NOT_PLAYED = [
    ("a.avi", "mpeg4", "yuv420p", "avi"),
    ("a.mp4", "mpeg4", "yuv420p", "mpeg4 in mp4"),
    ("a.mp4", "libx264", "yuv444p", "the pixel format yuv444p"),
    ("a.mkv", "libx264", "yuv420p", "matroska"),
    ("a.mov", "mjpeg", "yuvj420p", "mjpeg"),
    ("a.mpg", "mpeg2video", "yuv420p", "mpeg"),
]


@pytest.mark.parametrize(("name", "codec", "pixel_format"), PLAYED)
def test_what_browsers_play_is_left_alone(
    tmp_path: Path, name: str, codec: str, pixel_format: str
) -> None:
    video = probe(write(tmp_path / name, codec, pixel_format))
    assert video.hindrance is None
    assert (video.width, video.height) == (64, 48)
    assert video.duration_s == pytest.approx(3.0, abs=0.11)


@pytest.mark.parametrize(("name", "codec", "pixel_format", "said"), NOT_PLAYED)
def test_what_some_browser_cannot_play_is_named_and_transcoded(
    tmp_path: Path, name: str, codec: str, pixel_format: str, said: str
) -> None:
    source = write(tmp_path / name, codec, pixel_format)
    hindrance = probe(source).hindrance
    assert hindrance is not None
    assert said in hindrance
    seconds: list[float] = []
    transcode(source, tmp_path / "new.mp4", seconds.append)
    made = probe(tmp_path / "new.mp4")
    assert (made.hindrance, made.codec, made.pixel_format) == (None, "h264", "yuv420p")
    assert made.remarks == ()
    assert made.duration_s == pytest.approx(3.0, abs=0.15)
    assert len(seconds) == FRAMES
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "new.mp4"])


def test_a_transcoded_video_is_small_enough_and_silent(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mov", "mjpeg", "yuvj420p", (1602, 901), sound=True, frames=5)
    assert probe(source).has_audio
    transcode(source, tmp_path / "new.mp4")
    made = probe(tmp_path / "new.mp4")
    assert (made.width, made.height, made.has_audio) == (1280, 720, False)


def test_remarks_tell_what_does_no_harm(tmp_path: Path) -> None:
    late = probe(write(tmp_path / "a.mp4", sound=True))
    assert [remark.split(",")[0] for remark in late.remarks] == [
        "its index lies at its end: it starts late on a slow line",
        "it has sound",
    ]
    fast = write(tmp_path / "b.mp4", options={"movflags": "+faststart"})
    assert probe(fast).remarks == ()


def test_a_video_cut_off_at_its_end_is_named(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.mp4", options={"movflags": "+faststart"}).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UnreadableVideoError, match=r"cut off|damaged"):
        probe(tmp_path / "cut.mp4")


def test_a_picture_beyond_all_measure_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.video.probing.MOST_PIXELS", 1000)
    with pytest.raises(UnreadableVideoError, match="million pixels"):
        probe(write(tmp_path / "a.mp4"))


@pytest.mark.parametrize("keep", [True, False])
def test_a_folders_videos_are_transcoded_and_its_table_names_them(
    folder: Path, keep: bool, edit: Callable[[Path, str, str], None]
) -> None:
    (folder / "videos" / "a.mp4").unlink()
    write(folder / "videos" / "a.avi", "mpeg4")
    edit(folder / "recordings.csv", "videos/a.mp4", "videos/a.avi")
    with pytest.raises(StudyFaults) as caught:
        load(folder)
    [fault] = caught.value.faults
    assert (fault.line, fault.parts.expected) == (
        2,
        "a video that every browser plays, such as H.264 in MP4",
    )
    reported: list[tuple[int, int]] = []
    names = transcode_folder(folder, lambda done, total: reported.append((done, total)), keep=keep)
    assert names == ["videos/a.mp4"]
    assert reported[-1] == (3, 3)
    assert (folder / "videos" / "a.avi").exists() is keep
    assert load(folder).recordings[0].file == "videos/a.mp4"
    assert transcode_folder(folder, lambda *_: None, keep=keep) == []


def test_a_transcoded_video_takes_no_other_ones_name(
    folder: Path, edit: Callable[[Path, str, str], None]
) -> None:
    write(folder / "videos" / "c.avi", "mpeg4")
    edit(folder / "recordings.csv", "videos/b.mp4", "videos/c.avi")
    assert transcode_folder(folder, lambda *_: None, keep=True) == ["videos/c-h264.mp4"]
    assert "videos/c.mp4" in (folder / "recordings.csv").read_text()
