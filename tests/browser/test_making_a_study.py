"""An experimenter makes a study in a real browser: three faults named, put right, tried, opened."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from tests.functional.desk import zipped

from .conftest import EMAIL, PASSWORD
from .for_everyone import violations
from .forked import ForkedServer
from .server import Server
from .small_study import SMALL_PLAN, write_small_study

PLAN = SMALL_PLAN.replace(
    "queries_per_trial: 4",
    "  - {name: last one wins, method: knockout, environment: kitchen}\nqueries_per_trial: 3",
)
#: Where to leave pictures of the pages, for people to look at.
PICTURES = os.environ.get("PBPO_TEST_PICTURES")


@pytest.fixture
def empty_server(tmp_path: Path, media_dir: Path) -> Iterator[Server]:
    """A server with an experimenter and no study."""
    data_dir = tmp_path / "data"
    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir))
    accounts.create(app, EMAIL, PASSWORD)
    app.close()
    server = ForkedServer(data_dir, media_dir)
    server.start()
    yield server
    server.kill()


def looked_at(page: Page, name: str) -> None:
    """The page holds WCAG 2.2 AA and is no wider than its window, also at 1280 px and 400 %."""
    for width in (1440, 768, 360, 320):
        page.set_viewport_size({"width": width, "height": 900})
        overflow = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert overflow <= 0, f"{name} is {overflow} px too wide at {width}"
        if PICTURES:
            page.screenshot(path=f"{PICTURES}/{name}-{width}.png", full_page=True)
    assert violations(page) == [], name
    page.set_viewport_size({"width": 1280, "height": 800})


def test_from_a_zip_with_three_faults_to_an_open_study(
    page: Page, empty_server: Server, tmp_path: Path
) -> None:
    folder = write_small_study(tmp_path / "study", PLAN)
    sound = {
        name: (folder / name).read_bytes()
        for name in ("study.yaml", "recordings.csv", "videos/0-1.mp4")
    }
    (folder / "study.yaml").write_bytes(sound["study.yaml"].replace(b"trial: 3", b"trial: three"))
    (folder / "recordings.csv").write_bytes(sound["recordings.csv"].replace(b"0.2,", b"fast,", 1))
    (folder / "videos" / "0-1.mp4").write_bytes(sound["videos/0-1.mp4"][:400])
    packed = tmp_path / "small.zip"
    packed.write_bytes(zipped(folder, "small/"))

    page.goto(f"{empty_server.url}/studies")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    page.get_by_test_id("new-study").click()
    page.wait_for_url("**/studies/new")
    looked_at(page, "new")
    page.get_by_test_id("draft-files").set_input_files(packed)
    page.get_by_test_id("begin-draft").click()

    # Three faults, each with its row, what was expected and what came.
    expect(page.get_by_test_id("faults-count")).to_have_text("3 faults to put right")
    faults = page.get_by_test_id("faults")
    expect(faults).to_contain_text(["recordings.csv", "queries_per_trial"])
    expect(page.get_by_role("cell", name="'three'")).to_be_visible()
    expect(page.get_by_role("cell", name="'fast'")).to_be_visible()
    expect(page.get_by_role("cell", name="videos/0-1.mp4': it is no")).to_be_visible()
    looked_at(page, "faults")

    # Put right by the form, by hand, and by sending a file again.
    page.get_by_test_id("settings").click()
    page.wait_for_url("**/settings")
    looked_at(page, "settings")
    page.get_by_label("Pairs per trial").fill("3")
    page.get_by_test_id("save-settings").click()
    expect(page.get_by_test_id("faults-count")).to_have_text("2 faults to put right")
    page.get_by_role("link", name="Change recordings.csv").click()
    page.wait_for_url("**/text?**")
    looked_at(page, "text")
    text = page.get_by_test_id("draft-text")
    text.fill(text.input_value().replace("fast,", "0.2,"))
    page.get_by_test_id("save-text").click()
    expect(page.get_by_test_id("faults-count")).to_have_text("1 fault to put right")
    again = tmp_path / "0-1.mp4"
    again.write_bytes(sound["videos/0-1.mp4"])
    page.get_by_test_id("draft-files").set_input_files(again)
    page.get_by_test_id("add-files").click()
    expect(page.get_by_test_id("sound")).to_contain_text("2 trials of 3 pairs")
    looked_at(page, "sound")
    page.get_by_test_id("create-study").click()

    # Looked at as an evaluator would.
    page.get_by_test_id("preview-study").click()
    expect(page.get_by_test_id("consent")).to_be_visible()

    # Twenty simulated evaluators, with their progress, and what they tell.
    page.goto(f"{empty_server.url}/studies/small/manage")
    page.get_by_test_id("simulate-sessions").fill("20")
    page.get_by_test_id("simulate").click()
    expect(page.get_by_test_id("job")).to_be_visible()
    if PICTURES:
        page.screenshot(path=f"{PICTURES}/job-1280.png")
    expect(page.get_by_test_id("simulated")).to_contain_text(
        "20 simulated sessions were completed", timeout=180_000
    )
    expect(page.get_by_test_id("contrasts")).to_contain_text("last one wins less with skip")
    looked_at(page, "manage-draft")

    page.get_by_test_id("open-study").click()
    expect(page.get_by_test_id("doubts")).to_contain_text("never chooses a pair")
    looked_at(page, "open")
    page.get_by_test_id("confirm-open").click()
    expect(page.get_by_test_id("status")).to_have_text("Open")
    expect(page.get_by_test_id("plan-hash")).to_have_text(re.compile("^[0-9a-f]{64}$"))
    looked_at(page, "manage-open")
    for name in ("recruit", "plan", "texts"):
        page.goto(f"{empty_server.url}/studies/small/{name}")
        looked_at(page, name)
    page.goto(f"{empty_server.url}/studies")
    looked_at(page, "studies")


def test_from_videos_and_a_german_spreadsheet_to_texts_that_are_left_to_write(
    page: Page, empty_server: Server, tmp_path: Path
) -> None:
    folder = write_small_study(tmp_path / "study", PLAN)
    with (folder / "recordings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = tmp_path / "Versuch.csv"
    lines = ["Geschwindigkeit [m/s];Höhe (m);Videodatei;Bemerkung"] + [
        f"{row['speed'].replace('.', ',')};{n},5;C:\\Videos\\{Path(row['file']).name};gut"
        for n, row in enumerate(rows)
    ]
    table.write_bytes("\r\n".join(lines).encode("cp1252"))

    page.goto(f"{empty_server.url}/studies")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    page.get_by_test_id("new-study").click()
    page.get_by_test_id("draft-name").fill("Kippen über Gläsern")
    page.get_by_test_id("draft-files").set_input_files(
        [table, *sorted((folder / "videos").iterdir())]
    )
    page.get_by_test_id("begin-draft").click()
    expect(page.get_by_test_id("step-videos")).to_contain_text("Done")
    expect(page.get_by_test_id("remarks")).to_contain_text("semicolons and decimal commas")
    expect(page.get_by_test_id("remarks")).to_contain_text("Bemerkung")
    expect(page.get_by_test_id("step-texts")).to_contain_text("Fill in texts/en/consent.md")
    expect(page.get_by_test_id("step-texts")).to_have_attribute("aria-current", "step")
    looked_at(page, "steps")
    for name in ("consent", "instructions", "debrief"):
        page.get_by_role("link", name=f"Fill in texts/en/{name}.md").click()
        expect(page.get_by_test_id("rendered")).to_be_visible()
        looked_at(page, f"fill-in-{name}")
        text = page.get_by_test_id("draft-text")
        text.fill(re.sub(r"\[.+?\]", "own words [1]", text.input_value()))
        page.get_by_test_id("save-text").click()
    expect(page.get_by_test_id("step-create")).to_contain_text("Next")
    expect(page.get_by_test_id("sound")).to_contain_text("Kippen über Gläsern")
    looked_at(page, "ready")
