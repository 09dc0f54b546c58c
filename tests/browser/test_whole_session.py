"""A person takes part, and the experimenter downloads exactly what was pressed."""

from __future__ import annotations

import io
import zipfile

import pandas as pd
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from .conftest import EMAIL, PASSWORD
from .evaluator import answer, enter, may_skip, query_on_screen, watch
from .server import Server


@pytest.mark.long
def test_a_whole_session_ends_in_a_zip_that_holds_what_was_pressed(
    context: BrowserContext, page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    pressed = []
    for trial in (1, 2, 3):
        for query in (1, 2):
            watch(page)
            assert query_on_screen(page) == f"Part {trial} of 3 · Pair {query} of 2"
            response = "skip" if may_skip(page) and query == 2 else ("left", "right")[trial % 2]
            answer(page, response, by="key" if query == 2 else "mouse")
            pressed.append(response)
        if trial < 3:
            expect(page.get_by_test_id("continue")).to_be_enabled(timeout=10_000)
            page.get_by_test_id("continue").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Thank you")

    tables = download(context, server)
    queries = tables["queries"]
    assert list(queries["response"]) == pressed
    assert (queries["rt"] > 100).all()
    assert set(queries["condition"]) == {"pbpo", "no-synthesis", "no-skip"}
    assert pressed.count("skip") == 2
    chosen = queries.loc[queries["response"] == "left"]
    assert (chosen["chosen_candidate"] == chosen["left_candidate"]).all()
    assert list(tables["sessions"]["stage"]) == ["completed"]
    preferences = tables["preferences"]
    assert (preferences["origin"] == "answer").sum() == 4
    # The one skip of the condition that learns from skips makes two preferences; unless it was of
    # the very candidate that had been chosen: nothing is between the two then.
    first, second = queries.loc[queries["condition"] == "pbpo"].to_dict("records")
    skipped = {second["left_candidate"], second["right_candidate"]}
    made = 0 if first["chosen_candidate"] in skipped else 2
    assert (preferences["origin"] == "synthesis").sum() == made
    assert {"playing"} <= set(tables["events"]["event"])


def download(context: BrowserContext, server: Server) -> dict[str, pd.DataFrame]:
    """Sign in as the experimenter, follow the link to the zip, and open it in pandas."""
    page = context.new_page()
    page.goto(f"{server.url}/studies/short")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    expect(page.get_by_test_id("sessions")).to_contain_text("completed", ignore_case=True)
    with page.expect_download() as downloading:
        page.get_by_test_id("export-zip").click()
    with zipfile.ZipFile(downloading.value.path()) as archive:
        return {
            name.removesuffix(".csv"): pd.read_csv(io.BytesIO(archive.read(name)))
            for name in archive.namelist()
            if name.endswith(".csv")
        }
