"""A key that scrolls a page does nothing else there: a person who scrolls must not answer by it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from .evaluator import answer, enter_small, query_on_screen, watch
from .server import Server
from .small_study import BILINGUAL_PLAN, SMALL_PLAN
from .test_faults import stored_responses
from .test_odd_browsers import BREAK_PLAN, BREAK_S

Serve = Callable[[str], Server]

#: Windows of laptops, a tablet held upright, and one as narrow as a phone.
WINDOWS = [
    (1280, 600),
    (1366, 657),
    (1536, 730),
    (1440, 900),
    (1024, 768),
    (768, 900),
    (768, 1024),
    (360, 740),
]

EIGHT_PAIRS = BILINGUAL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 8")

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


@pytest.mark.parametrize("language", ["en", "ja"])
def test_in_every_ordinary_window_all_keys_work(page: Page, serve: Serve, language: str) -> None:
    server = serve(EIGHT_PAIRS)
    page.set_viewport_size({"width": WINDOWS[0][0], "height": WINDOWS[0][1]})
    enter_small(page, f"{server.url}/s/small?lang={language}")
    for width, height in WINDOWS:
        page.set_viewport_size({"width": width, "height": height})
        needed = page.evaluate("document.documentElement.scrollHeight")
        assert needed <= height, f"{needed} px in a window of {width} by {height}"
        answer(page, "skip", by="key")
        if (width, height) != WINDOWS[-1]:
            watch(page)
    assert stored_responses(server) == ["skip"] * len(WINDOWS)


def test_the_arrows_work_after_a_button_was_used_by_keyboard(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.get_by_test_id("replay").focus()
    page.keyboard.press("Enter")
    answer(page, "left", by="key")
    watch(page)
    assert stored_responses(server) == ["left"]


def test_a_break_that_ends_is_not_left_by_the_key_that_scrolls(page: Page, serve: Serve) -> None:
    server = serve(BREAK_PLAN.replace(f"break_s: {BREAK_S}", "break_s: 1"))
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
