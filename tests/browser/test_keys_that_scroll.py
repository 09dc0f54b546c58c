"""A key that scrolls a page does nothing else there: a person who scrolls must not answer by it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from .evaluator import answer, enter_small, query_on_screen, watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_faults import stored_responses
from .test_odd_browsers import BREAK_PLAN

Serve = Callable[[str], Server]

SCROLLING = ("ArrowDown", "Space", "PageDown", "End", "ArrowUp", "PageUp", "Home")


def hints(page: Page) -> list[str]:
    """The keys that are shown on the page."""
    keys = page.locator("kbd.key").all()
    return [key.inner_text() for key in keys if key.is_visible()]


def test_on_a_page_that_scrolls_no_scrolling_key_answers_anything(page: Page, serve: Serve) -> None:
    page.set_viewport_size({"width": 480, "height": 300})
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    before = page.evaluate("scrollY")
    page.keyboard.press("ArrowDown")
    page.wait_for_function("(before) => scrollY > before", arg=before)
    for key in SCROLLING:
        page.keyboard.press(key)
    page.keyboard.press("Space")
    page.wait_for_function("() => scrollY > 100")
    page.wait_for_timeout(300)
    assert query_on_screen(page) == "Part 1 of 1 · Pair 1 of 4"
    answer(page, "left", by="key")  # it does not scroll sideways
    watch(page)
    assert stored_responses(server) == ["left"]


def test_on_a_page_that_scrolls_sideways_neither_side_is_chosen_by_scrolling(
    page: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.evaluate("document.body.style.width = '2000px'")
    for key in ("ArrowRight", "ArrowLeft"):
        page.keyboard.press(key)
    page.wait_for_timeout(300)
    assert query_on_screen(page) == "Part 1 of 1 · Pair 1 of 4"
    assert stored_responses(server) == []


def test_the_page_names_the_keys_that_work(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    assert sorted(hints(page)) == sorted(["←", "↓", "→", "Space"])
    page.evaluate("document.body.style.minHeight = '3000px'")
    expect(page.locator("kbd.key", has_text="Space")).to_be_hidden()
    assert sorted(hints(page)) == sorted(["←", "→"])
    page.evaluate("document.body.style.minHeight = ''")
    expect(page.locator("kbd.key", has_text="Space")).to_be_visible()


@pytest.mark.parametrize("size", [(1280, 600), (1366, 657), (1536, 730), (1440, 900), (1024, 768)])
def test_in_the_window_of_an_ordinary_laptop_all_keys_work(
    page: Page, serve: Serve, size: tuple[int, int]
) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    height = page.evaluate("document.documentElement.scrollHeight")
    assert height <= size[1]
    answer(page, "skip", by="key")
    watch(page)
    assert stored_responses(server) == ["skip"]


def test_the_arrows_work_after_a_button_was_used_by_keyboard(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.get_by_test_id("replay").focus()
    page.keyboard.press("Enter")
    answer(page, "left", by="key")
    watch(page)
    assert stored_responses(server) == ["left"]


def test_a_break_that_ends_is_not_left_by_the_key_that_scrolls(page: Page, serve: Serve) -> None:
    server = serve(BREAK_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_test_id("continue")).to_be_enabled()
    for key in ("Space", "Enter", "ArrowDown", "PageDown"):
        page.keyboard.press(key)
    page.wait_for_timeout(300)
    expect(page.get_by_role("heading", level=1)).to_have_text("Take a break")


def test_the_familiarisation_scrolls_by_the_keys_that_scroll(page: Page, serve: Serve) -> None:
    page.set_viewport_size({"width": 480, "height": 300})
    server = serve(SMALL_PLAN + "familiarisation: {videos: 2, required: 0}\n")
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_text("Video 1 of 2")).to_be_visible()
    page.keyboard.press("Space")
    page.wait_for_function("() => scrollY > 100")
    expect(page.get_by_role("heading", level=1)).to_have_text("Get to know the videos")
