"""Faults in the list of recordings and in the videos are named with their row."""

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from app.study.folder import load

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "0.2,1,videos/c",
            "fast,1,videos/c",
            "recordings.csv:4: speed: expected a finite number, got 'fast'",
        ),
        (
            "0.2,1,videos/c",
            "0.2,nan,videos/c",
            "recordings.csv:4: height: expected a finite number, got 'nan'",
        ),
        (
            "0.2,1,videos/c",
            "1e999,1,videos/c",
            "recordings.csv:4: speed: expected a finite number, got '1e999'",
        ),
        (
            "0.2,1,videos/c",
            ",1,videos/c",
            "recordings.csv:4: speed: expected a finite number, got ''",
        ),
        ("-3.5", "good", "recordings.csv:2: score: expected a finite number, got 'good'"),
        (
            "videos/a.mp4",
            "videos/z.mp4",
            "recordings.csv:2: file: expected a video, there is no file 'videos/z.mp4'",
        ),
        (
            "videos/b.mp4",
            "videos",
            "recordings.csv:3: file: expected a video, there is no file 'videos'",
        ),
        ("videos/b.mp4", "", "recordings.csv:3: file: expected the name of a file, got nothing"),
        (
            "videos/b.mp4",
            "./videos/a.mp4",
            (
                "recordings.csv:3: file: expected each file once, got './videos/a.mp4' again"
                " (first in recordings.csv:2)"
            ),
        ),
        (
            "videos/b.mp4",
            "../z.mp4",
            "recordings.csv:3: file: expected a path inside the study folder, got '../z.mp4'",
        ),
        (
            "videos/b.mp4",
            "/etc/passwd",
            "recordings.csv:3: file: expected a path inside the study folder, got '/etc/passwd'",
        ),
        (
            "videos/b.mp4",
            "videos\\z.mp4",
            "recordings.csv:3: file: expected a video, there is no file 'videos\\z.mp4'",
        ),
        (
            "0.2,1,videos/c.mp4,-1e1",
            "0.2,1,videos/c.mp4",
            "recordings.csv:4: expected 4 values as in the header, got 3",
        ),
        (
            "speed,height,file",
            "speed,high,file",
            "recordings.csv:1: expected a column height, got speed, high, file, score",
        ),
        (
            "speed,height,file,score",
            "speed,height,file,file",
            "recordings.csv:1: expected each column once, got file 2 times",
        ),
        (
            "0.2,1,videos/c",
            "0.1,1,videos/c",
            "recordings.csv: expected at least two different candidates, got 1",
        ),
        (
            "videos/b.mp4",
            '"videos/b.mp4',
            "recordings.csv:3: expected values separated by commas, got: unexpected end of data",
        ),
    ],
)
def test_a_fault_in_the_recordings_is_named_with_its_line(
    folder: Path, edit: Edit, faults: Faults, old: str, new: str, expected: str
) -> None:
    edit(folder / "recordings.csv", old, new)
    assert expected in faults(folder)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("50,000", "write 50000 or 50, whichever is meant"),
        ("1_000", "write 1000, whichever is meant"),
        ("1 000", "write 1000, whichever is meant"),
        ("0,2", "write 0.2, with a decimal point"),
        ("20%", "write 20 or 0.2, whichever is meant"),
    ],
)
def test_a_number_that_is_not_written_with_a_point_is_asked_back(
    folder: Path, edit: Edit, faults: Faults, typed: str, meant: str
) -> None:
    edit(folder / "recordings.csv", "0.2,1,videos/c", f'"{typed}",1,videos/c')
    expected = f"recordings.csv:4: speed: expected a finite number, got {typed!r} ({meant})"
    assert expected in faults(folder)


def test_a_column_that_could_be_thousands_is_read_as_written_and_said_so(
    folder: Path, edit: Edit
) -> None:
    def remarks() -> list[str]:
        return [str(one) for one in load(folder).remarks if "is read as" in str(one)]

    assert not remarks()
    for old, new in (("0.1,", "1.250,"), ("0.1,", "1.250,"), ("0.2,", "2.500,")):
        text = (folder / "recordings.csv").read_text()
        (folder / "recordings.csv").write_text(text.replace(old, new))
    assert sorted({row.candidate[0] for row in load(folder).recordings}) == [1.25, 2.5]
    (remark,) = remarks()
    assert "speed: 1.250 is read as 1.25" in remark
    assert "write 1250 if thousands are meant" in remark
    # Another value of the column settles it.
    text = (folder / "recordings.csv").read_text()
    (folder / "recordings.csv").write_text(text.replace("2.500,", "2.5,"))
    assert not remarks()


def test_lines_are_counted_as_an_editor_counts_them(folder: Path, faults: Faults) -> None:
    text = 'speed,height,file,score\n\n"0.1",1,"videos/a\nb.mp4",\n\nx,1,videos/c.mp4,\n'
    (folder / "recordings.csv").write_text(text)
    assert [fault.split(": ")[0] for fault in faults(folder)[:2]] == [
        "recordings.csv:3",
        "recordings.csv:6",
    ]


def test_the_same_video_under_two_names_is_named_with_both_rows(
    folder: Path, faults: Faults
) -> None:
    (folder / "videos" / "b.mp4").write_bytes((folder / "videos" / "a.mp4").read_bytes())
    assert faults(folder) == [
        (
            "recordings.csv:3: file: expected each video once, got 'videos/b.mp4'"
            " with the same content as the one in recordings.csv:2"
        )
    ]


def test_what_only_looks_like_a_video_is_named(
    folder: Path, faults: Faults, tmp_path: Path
) -> None:
    videos = folder / "videos"
    (videos / "a.mp4").write_text("not a video at all\n")
    Image.new("RGB", (8, 8)).save(videos / "b.mp4", format="PNG")
    (videos / "c.mp4").write_bytes((videos / "c.mp4").read_bytes()[:300])
    assert [
        (fault[:22], "expected a video that can be played" in fault) for fault in faults(folder)
    ] == [
        ("recordings.csv:2: file", True),
        ("recordings.csv:3: file", True),
        ("recordings.csv:4: file", True),
    ]


def test_a_playlist_cannot_pass_for_a_video_and_fetch_other_files(
    folder: Path, faults: Faults
) -> None:
    target = (folder / "videos" / "a.mp4").as_posix()
    (folder / "videos" / "b.mp4").write_text(
        f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{target}\n#EXT-X-ENDLIST\n"
    )
    [fault] = faults(folder)
    assert fault.startswith("recordings.csv:3: file: expected a video that can be played")


def test_links_out_of_the_folder_are_not_followed(
    folder: Path, faults: Faults, tmp_path: Path
) -> None:
    for file in ("videos/a.mp4", "texts/en/consent.md"):
        outside = tmp_path / Path(file).name
        (folder / file).rename(outside)
        (folder / file).symlink_to(outside)
    assert faults(folder) == [
        "texts/en/consent.md: expected a file inside the study folder, got a link out of it",
        (
            "recordings.csv:2: file: expected a file inside the study folder,"
            " got the link 'videos/a.mp4'"
        ),
    ]


def test_a_missing_and_an_empty_list_of_recordings_are_named(folder: Path, faults: Faults) -> None:
    (folder / "recordings.csv").write_text("\n")
    assert faults(folder) == ["recordings.csv: expected a header row, got an empty file"]
    (folder / "recordings.csv").write_text("speed,height,file\n")
    assert faults(folder) == ["recordings.csv: expected at least two different candidates, got 0"]
    (folder / "recordings.csv").unlink()
    assert faults(folder) == ["recordings.csv: expected a file of this name, there is none"]


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"", "it is empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(40), "it is a picture (PNG)"),
        (b"\xff\xd8\xff\xe0" + bytes(40), "it is a picture (JPEG)"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n", "a pointer of Git LFS"),
        (b"<!DOCTYPE html><p>Sign in", "it is a web page"),
        (b"to be filmed\n", "it is a text"),
    ],
)
def test_a_file_that_is_no_video_is_said_to_be_what_it_is(
    folder: Path, faults: Faults, content: bytes, kind: str
) -> None:
    (folder / "videos" / "b.mp4").write_bytes(content)
    [fault] = faults(folder)
    assert fault.startswith("recordings.csv:3: file: expected a video that can be played")
    assert kind in fault
