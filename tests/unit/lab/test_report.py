"""The report, written from results whose outcome was chosen."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import app
from app.lab.experiments import EXPERIMENTS, FIGURES, Task
from app.lab.readings import CAPTIONS, READINGS, Reading
from app.lab.report import write_report
from app.lab.results import Results

DOCS = Path(app.__file__).parents[1] / "docs"
LARGEST_FILE = 300_000
LARGEST_FOLDER = 3_000_000


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory,
    make_results: Callable[[Callable[[Task], int]], Results],
) -> Path:
    folder = tmp_path_factory.mktemp("report")
    results = make_results(lambda task: 5 + 3 * task.trial if task.method == "pbpo" else 30)
    write_report(results, FIGURES, folder)
    return folder


def test_every_figure_has_its_section_with_images_that_are_there(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    for figure in FIGURES:
        assert f"## Figure {figure}: {CAPTIONS[figure]}" in text
    images = re.findall(r"!\[[^]]+\]\((figures/[^)]+)\)", text)
    assert len(images) == len(FIGURES) + 2  # Fig. 19 and 20 have one for each environment
    for image in images:
        assert (folder / image).stat().st_size > 1000
        assert (folder / image).with_suffix(".png").stat().st_size > 1000


def test_every_claim_stands_in_the_report_and_in_the_table_with_its_verdict(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    with (folder / "claims.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {int(row["figure"]) for row in rows} == set(FIGURES)
    for row in rows:
        assert row["published"].replace("|", "\\|") in text
        assert row["ours"] in text
    held = sum(row["holds"] == "True" for row in rows)
    assert f"Of {len(rows)} claims, {held} hold and {len(rows) - held} do not." in text


def test_a_report_of_too_few_trials_says_so(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert "Fewer trials than the paper: 6 of 50 (certain)" in text


def test_the_report_lists_the_settings_it_was_run_under(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    for words in ("0.0001", "length scale", "Student-t", "skips below", "120 crane runs"):
        assert words in text


def test_a_reading_appears_only_beside_the_verdicts_it_was_written_from() -> None:
    reading = Reading({"a": True, "b": False}, "because")
    assert reading.applies({"a": True, "b": False, "c": True})
    assert not reading.applies({"a": True, "b": True})
    assert not reading.applies({"a": True})


def test_readings_belong_to_figures_that_are_drawn() -> None:
    assert set(READINGS) <= set(FIGURES) == set(CAPTIONS)


def test_the_report_kept_with_the_code_is_whole_small_and_of_the_papers_size() -> None:
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    images = re.findall(r"!\[[^]]+\]\((figures/[^)]+)\)", text)
    # Two of them are drawn for each environment; one more shows what the skip threshold changes.
    assert len(images) == len(FIGURES) + 2 + 1
    sizes = [(DOCS / image).stat().st_size for image in images]
    assert max(sizes) < LARGEST_FILE
    assert sum(sizes) < LARGEST_FOLDER
    assert "Fewer trials" not in text
    for experiment in EXPERIMENTS:
        assert f"| {experiment.name} |" in text
