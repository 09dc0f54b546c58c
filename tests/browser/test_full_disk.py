"""A disk without room: the evaluator is told, and what they answered waits in their browser."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page, expect

from .evaluator import enter_small, query_on_screen, watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_faults import stored_responses


def test_what_is_answered_while_the_disk_is_full_is_saved_once_there_is_room(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    server.let_write(most_bytes=0)
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("Not saved yet")).to_be_visible()
    assert stored_responses(server) == []

    # Whoever loads the page anew is not asked again: the answer is in the browser.
    page.reload()
    expect(page.get_by_text("Not saved yet")).to_be_visible()
    assert query_on_screen(page) == "Part 1 of 1 · Pair 1 of 4"
    expect(page.get_by_test_id("answer-left")).to_be_disabled()

    server.let_write()
    page.get_by_role("button", name="Try now").click()
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 1 · Pair 2 of 4")
    watch(page)
    expect(page.get_by_text("Not saved yet")).to_be_hidden()
    assert stored_responses(server) == ["right"]


def test_a_form_that_cannot_be_stored_leads_to_a_page_that_says_so_and_back(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    page.goto(f"{server.url}/s/small")
    server.let_write(most_bytes=0)
    page.get_by_test_id("consent").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Something of ours has failed")
    server.let_write()
    page.get_by_test_id("try-again").click()
    page.get_by_test_id("consent").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("What you will do")
