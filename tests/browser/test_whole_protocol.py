"""Every stage that a study may have, one after the other, in a real browser."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from .evaluator import answer, query_on_screen, watch
from .server import Server
from .small_study import SMALL_PLAN

WHOLE_PLAN = (
    SMALL_PLAN
    + """
device_check: {min_width_px: 600, min_mbit_s: 0.1}
familiarisation: {videos: 3, required: 2, speeds: [1, 4]}
practice: {queries: 1}
questionnaires:
  after_trial:
    - {name: effort, type: likert, points: 5, label: "How hard was it?", labels: [Easy, Hard]}
  end:
    - {name: age, type: number, min: 18, label: "How old are you?"}
"""
)


def expect_heading(page: Page, text: str) -> None:
    expect(page.get_by_role("heading", level=1)).to_have_text(text)


@pytest.mark.long
def test_a_session_goes_through_every_stage_there_is(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(WHOLE_PLAN)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()

    expect_heading(page, "Is your device up to it?")
    expect(page.get_by_test_id("continue")).to_be_enabled()
    page.get_by_test_id("continue").click()
    expect_heading(page, "What you will do")
    page.get_by_test_id("continue").click()

    expect_heading(page, "Get to know the videos")
    expect(page.get_by_test_id("continue")).to_be_disabled()
    page.get_by_role("button", name="4×").click()
    expect(page.get_by_test_id("watched")).to_contain_text("2 watched, 1 remain")
    page.reload()
    expect(page.get_by_test_id("watched")).to_contain_text("watched")
    expect(page.get_by_test_id("continue")).to_be_enabled()
    page.get_by_test_id("continue").click()

    watch(page)
    assert query_on_screen(page) == "Practice · Pair 1 of 1"
    answer(page, "left", by="key")
    for query in range(1, 5):
        expect(page.get_by_test_id("progress")).to_contain_text(f"{query} of 4")
        watch(page)
        answer(page, "right", by="key")

    expect_heading(page, "About the part you have just finished")
    page.get_by_test_id("continue").click()
    expect(page.get_by_role("alert")).to_be_visible()
    page.get_by_role("radio", name="1 Easy").check()
    page.get_by_test_id("continue").click()
    expect_heading(page, "A few last questions")
    page.get_by_label("How old are you?").fill("30")
    page.get_by_test_id("continue").click()
    expect_heading(page, "All comparisons are done")


def test_a_page_that_is_too_narrow_says_what_to_do_and_passes_once_it_is_wide(
    browser: Browser, serve: Callable[[str], Server]
) -> None:
    server = serve(WHOLE_PLAN)
    page = browser.new_page(viewport={"width": 400, "height": 740})
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    expect(page.get_by_text("Make the window wider")).to_be_visible()
    expect(page.get_by_test_id("screen-out")).to_be_visible()
    expect(page.get_by_test_id("continue")).to_be_disabled()
    page.set_viewport_size({"width": 800, "height": 740})
    expect(page.get_by_test_id("continue")).to_be_enabled()
    page.get_by_test_id("continue").click()
    expect_heading(page, "What you will do")
    page.close()
