"""A sound study is asked about where a person would raise an eyebrow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.study.doubts import doubts
from app.study.folder import load

Edit = Callable[[Path, str, str], None]


def asked(folder: Path, random_queries: int = 2) -> str:
    study = load(folder)
    found = doubts(
        study.plan, study.texts, study.recordings, study.unused, lambda _: random_queries
    )
    return " | ".join(map(str, found))


def test_nothing_is_asked_about_a_study_without_oddities(folder: Path) -> None:
    table = folder / "recordings.csv"
    table.write_text(
        "speed,height,file\n0.1,1,videos/a.mp4\n0.1,2,videos/b.mp4\n0.2,1,videos/c.mp4\n"
    )
    for text in (folder / "texts" / "en").iterdir():
        text.write_text("There are {{ queries_per_trial }} pairs, see [1].\n")
    assert asked(folder) == ""


@pytest.mark.parametrize(
    ("file", "old", "new", "question"),
    [
        ("study.yaml", "trial: 4", "trial: 2", "condition with skip: the method never chooses"),
        ("recordings.csv", "0.2,1,", "0.2,1,", "height is 1.0 in every row: it has no effect"),
        ("recordings.csv", "0.2,1,", "0.2,1,", "2 of 3 rows have a score"),
        ("recordings.csv", "0.2,1,", "0.10000000000000002,1,", "is one meant?"),
        ("recordings.csv", "0.1,1,videos/b.mp4,\n", "", "1 video is in no table"),
        ("texts/en/consent.md", "# The", "There are 30 pairs.\n\n# The", "it says '30 pairs'"),
        ("texts/en/consent.md", "# The", "# The", "it has a heading and no text"),
    ],
)  # fmt: skip
def test_an_oddity_is_asked_about(
    folder: Path, edit: Edit, file: str, old: str, new: str, question: str
) -> None:
    if old != new:
        edit(folder / file, old, new)
    assert question in asked(folder)


def test_lengths_that_differ_and_languages_without_pages_are_asked_about(
    folder: Path, write_video: Callable[..., None], edit: Edit
) -> None:
    write_video(folder / "videos" / "b.mp4", 90, frames=20)
    edit(folder / "study.yaml", "languages: [en]", "languages: [de]")
    (folder / "texts" / "en").rename(folder / "texts" / "de")
    said = asked(folder)
    assert "videos/b.mp4 lasts 4 s: the shorter of a pair waits for the longer" in said
    assert "the study is in de: the studio has no translation of them" in said
    (folder / "texts" / "de" / "words.po").write_text('msgid "Stop"\nmsgstr "Aufhören"\n')
    assert "the study is in de" not in asked(folder)


def test_numbers_in_texts_come_from_the_plan(folder: Path) -> None:
    (folder / "texts" / "en" / "consent.md").write_text(
        "{{queries_per_trial}} pairs, {{ pairs_per_session }} in all, {{%ID%}}.\n"
    )
    assert load(folder).texts["en"]["consent"] == "4 pairs, 8 in all, {{%ID%}}.\n"


def test_a_value_that_no_plan_has_is_a_fault(
    folder: Path, faults: Callable[[Path], list[str]]
) -> None:
    (folder / "texts" / "en" / "consent.md").write_text("Hello {{ name }}\n")
    assert "got {{ name }}" in faults(folder)[0]
