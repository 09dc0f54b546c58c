"""Two phones and a laptop teach one model at once, one of them leaves, and the results say so."""

from __future__ import annotations

import io
import os
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from typing import Any

import pandas as pd
import pytest
from playwright.sync_api import Browser, Page, Playwright, expect

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings

from .conftest import EMAIL, PASSWORD, PATIENCE_MS
from .evaluator import answer, enter_small, watch
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN

PAIRS = 5
CANDIDATES = 10
PLAN = (
    SMALL_PLAN.replace("method: pbpo\n", "method: pbpo-threshold\n    model: shared\n")
    .replace("queries_per_trial: 4", f"queries_per_trial: {PAIRS}")
    .replace("name: with skip", "name: together")
)


@pytest.mark.long
def test_three_people_at_once_teach_one_model_and_one_of_them_leaves(
    playwright: Playwright, browser: Browser, serve: Callable[..., Server]
) -> None:
    server = serve(PLAN, candidates=CANDIDATES)
    iphone, pixel = ({**playwright.devices[name]} for name in ("iPhone 13", "Pixel 7"))
    contexts = [browser.new_context(**_as_chromium(one)) for one in (iphone, pixel)]
    contexts.append(browser.new_context(viewport={"width": 1440, "height": 900}))
    for context in contexts:
        context.set_default_timeout(PATIENCE_MS)
    people = [context.new_page() for context in contexts]
    for page in people:
        enter_small(page, f"{server.url}/s/small")
    pressed: list[list[str]] = [[], [], []]
    assert len(set(open_pairs(server))) == 3
    for response in ("left", "skip"):
        for page, mine in zip(people, pressed, strict=True):
            _answer(page, response, mine)
            assert len(set(open_pairs(server))) == 3

    leaving, *others = people
    leaving.get_by_test_id("withdraw").click()
    leaving.get_by_test_id("withdraw-delete-open").click()
    leaving.get_by_test_id("withdraw-delete").click()
    expect(leaving.get_by_role("heading", name="Everything is deleted")).to_be_visible()
    for response in ("right", "left", "right"):
        for page, mine in zip(others, pressed[1:], strict=True):
            watch(page)
            _answer(page, response, mine)
    for page in others:
        page.get_by_test_id("continue").click()
        expect(page.get_by_role("heading", level=1)).to_have_text("Thank you")

    desk = contexts[2].new_page()
    tables = download(server, desk)
    queries = tables["queries"]
    answers = [list(own["response"]) for _, own in queries.groupby("session_id", sort=False)]
    assert answers == pressed[1:]
    # The model said how sure it was after each answer, in as many sessions as are left.
    assert tables["acquired"]["sureness"].between(0, 1).all()
    assert len(tables["acquired"]) == 2 * PAIRS
    assert list(tables["people"]["responses"]) == [PAIRS, PAIRS]
    assert set(tables["people"]["participant_id"]) == set(tables["sessions"]["participant_id"])
    assert len(tables["population"]) == CANDIDATES
    see_people_judged_together(server, desk)
    for context in contexts:
        context.close()


def _as_chromium(device: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in device.items() if key != "default_browser_type"}


def _answer(page: Page, response: str, pressed: list[str]) -> None:
    watch(page)
    answer(page, response, by="button")
    pressed.append(response)


def open_pairs(server: Server) -> list[frozenset[int]]:
    """The pairs that people are looking at."""
    with closing(sqlite3.connect(server.data_dir / "pbpo.sqlite3")) as database:
        rows = database.execute(
            "SELECT left_candidate, right_candidate FROM queries"
            " WHERE id NOT IN (SELECT query_id FROM responses)"
        )
        return [frozenset(row) for row in rows]


def download(server: Server, page: Page) -> dict[str, pd.DataFrame]:
    """Sign in as the experimenter, and open the zip of the exports in pandas."""
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    accounts.create(app, EMAIL, PASSWORD)
    app.close()
    page.goto(f"{server.url}/studies/small")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    with page.expect_download() as downloading:
        page.get_by_test_id("export-zip").click()
    with zipfile.ZipFile(downloading.value.path()) as archive:
        return {
            name.removesuffix(".csv"): pd.read_csv(io.BytesIO(archive.read(name)))
            for name in archive.namelist()
            if name.endswith(".csv")
        }


def see_people_judged_together(server: Server, page: Page) -> None:
    """The page of people judged together names both who stayed, on a phone and on a desk."""
    page.goto(f"{server.url}/studies/small/results")
    page.get_by_role("link", name="judged together").click()
    expect(page.get_by_test_id("people-says")).to_contain_text("2 people together like")
    expect(page.get_by_test_id("people-table").locator("tbody tr")).to_have_count(2)
    expect(page.get_by_test_id("people-table").get_by_text("5 (1 skip)")).to_have_count(2)
    for width in (360, 1440):
        page.set_viewport_size({"width": width, "height": 800})
        for figure in page.locator("figure.chart").all():
            figure.scroll_into_view_if_needed()
            expect(figure.locator("[data-chart]")).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert violations(page, "light") == []
        if folder := os.environ.get("PBPO_TEST_PICTURES"):
            page.screenshot(path=f"{folder}/people-{width}.png", full_page=True)
