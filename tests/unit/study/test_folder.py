"""A sound study folder is read as a whole, and its hash stands for all that is in it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from app.study import load, plan_hash

WriteVideo = Callable[..., None]
Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]


def test_a_sound_folder_is_read_completely(folder: Path) -> None:
    study = load(folder)
    assert study.root == folder
    assert study.plan.slug == "kettles"
    assert study.texts["en"]["debrief"] == "# The debrief (en)\n"
    assert [row.file for row in study.recordings] == [f"videos/{n}.mp4" for n in "abc"]
    assert [row.candidate for row in study.recordings] == [(0.1, 1.0), (0.1, 1.0), (0.2, 1.0)]
    assert [row.score for row in study.recordings] == [-3.5, None, -10.0]
    assert {row.environment for row in study.recordings} == {"kitchen"}
    assert [row.duration_s for row in study.recordings] == pytest.approx([0.4] * 3)
    assert len({row.sha256 for row in study.recordings}) == 3
    assert study.candidates("kitchen") == ((0.1, 1.0), (0.2, 1.0))


def test_a_csv_from_a_spreadsheet_is_read_as_well(folder: Path) -> None:
    text = "\ufeffheight , speed,file\r\n1, 0.1,videos/a.mp4\r\n\r\n,,\r\n1,.2,./videos/b.mp4\r\n"
    (folder / "recordings.csv").write_bytes(text.encode("utf-8"))
    rows = load(folder).recordings
    assert [row.candidate for row in rows] == [(0.1, 1.0), (0.2, 1.0)]
    assert [row.file for row in rows] == ["videos/a.mp4", "videos/b.mp4"]
    assert [row.score for row in rows] == [None, None]


def test_files_are_looked_for_beside_the_csv_and_named_from_the_folder(
    folder: Path, edit: Edit
) -> None:
    (folder / "recordings.csv").rename(folder / "videos" / "list.csv")
    edit(folder / "study.yaml", "recordings.csv", "videos/list.csv")
    (folder / "videos" / "list.csv").write_text("speed,height,file\n1,1,a.mp4\n2,1,b.mp4\n")
    assert [row.file for row in load(folder).recordings] == ["videos/a.mp4", "videos/b.mp4"]


def test_every_environment_has_recordings_of_its_own(
    folder: Path, edit: Edit, faults: Faults
) -> None:
    edit(
        folder / "study.yaml",
        "  kitchen: {source: recordings.csv}\n",
        "  kitchen: {source: recordings.csv}\n  lab: {source: lab.csv}\n",
    )
    edit(folder / "recordings.csv", "0.1,1,videos/b.mp4,\n", "")
    (folder / "lab.csv").write_text("speed,height,file\n1,1,videos/b.mp4\n2,1,videos/a.mp4\n")
    assert faults(folder) == [
        (
            "lab.csv:3: file: expected each file once, got 'videos/a.mp4' again"
            " (first in recordings.csv:2)"
        )
    ]


def test_a_video_that_does_not_state_its_length_is_measured(
    folder: Path, edit: Edit, write_video: WriteVideo
) -> None:
    # What a browser's recorder writes: a stream without a length in its header.
    write_video(folder / "videos" / "long.webm", 200, frames=7, live_format="webm")
    edit(folder / "recordings.csv", "videos/c.mp4", "videos/long.webm")
    assert load(folder).recordings[-1].duration_s == pytest.approx(1.4, abs=0.01)


# The hash of a folder


def test_comments_and_the_order_of_keys_do_not_change_the_hash(folder: Path, edit: Edit) -> None:
    def hashed() -> str:
        study = load(folder)
        return plan_hash(study.plan, study.texts, study.recordings)

    before = hashed()
    text = (folder / "study.yaml").read_text(encoding="utf-8")
    head, conditions = text.split("environments:")
    (folder / "study.yaml").write_text(
        "# another comment\nenvironments:" + conditions.replace("\n", "  # why\n") + head,
        encoding="utf-8",
    )
    edit(
        folder / "study.yaml",
        "{name: speed, label: Speed, unit: m/s}",
        '{unit: "m/s", name: speed, label: Speed}',
    )
    assert hashed() == before

    edit(folder / "study.yaml", "queries_per_trial: 4", "queries_per_trial: 5")
    assert hashed() != before


def test_a_word_in_a_text_and_a_byte_in_a_video_change_the_hash(
    folder: Path, write_video: WriteVideo
) -> None:
    def hashed() -> str:
        study = load(folder)
        return plan_hash(study.plan, study.texts, study.recordings)

    hashes = {hashed()}
    (folder / "texts" / "en" / "debrief.md").write_text("Goodbye.")
    hashes.add(hashed())
    write_video(folder / "videos" / "a.mp4", 250)
    hashes.add(hashed())
    assert len(hashes) == 3
