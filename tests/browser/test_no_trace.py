"""A new pair shows nothing of the answer to the last one, however that was given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Playwright, expect

from .evaluator import enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN

Serve = Callable[[str], Server]

#: Every computed style of each answer, its pseudo-classes, and where the page stands.
LOOK = """() => {
    const looks = {};
    for (const name of ["answer-left", "answer-right", "skip"]) {
        const button = document.querySelector(`[data-testid="${name}"]`);
        const style = getComputedStyle(button);
        const own = Object.fromEntries([...style].map((key) => [key, style.getPropertyValue(key)]));
        const names = button.getAttributeNames().sort();
        looks[name] = {
            style: own,
            attributes: Object.fromEntries(names.map((key) => [key, button.getAttribute(key)])),
            focused: button.matches(":focus"),
        };
    }
    return { looks, scroll: [scrollX, scrollY], focus: document.activeElement.tagName };
}"""

#: What differs between the two sides at all times: where they stand.
PLACED = ("grid-area", "grid-column", "grid-row", "inset", "left", "right")


@pytest.fixture
def touched(playwright: Playwright, browser: Browser) -> Iterator[Page]:
    described: dict[str, Any] = {
        **playwright.devices["iPhone 13"],
        "viewport": {"width": 360, "height": 740},
    }
    del described["default_browser_type"]
    context = browser.new_context(**described)
    yield context.new_page()
    context.close()


def press(page: Page, name: str, how: str) -> None:
    button = page.get_by_test_id(name)
    if how == "touch":
        button.tap()
    elif how == "mouse":
        button.click()
    else:
        button.focus()
        page.keyboard.press(how)


def expect_both_sides_alike(looks: dict[str, Any]) -> None:
    left, right = (dict(looks[name]["style"]) for name in ("answer-left", "answer-right"))
    for key in [key for key in left if key.startswith(PLACED)]:
        left.pop(key), right.pop(key)
    assert left == right


def next_pair(page: Page, number: int) -> None:
    expect(page.get_by_test_id("progress")).to_contain_text(f"Pair {number} of 4")
    watch(page)


@pytest.mark.parametrize("how", ["mouse", "Enter", "Space"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_next_pair_looks_as_the_first_one_did(
    page: Page, serve: Serve, how: str, scheme: Any
) -> None:
    page.emulate_media(color_scheme=scheme)
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    before = page.evaluate(LOOK)
    expect_both_sides_alike(before["looks"])
    for number, name in enumerate(("answer-left", "answer-right", "skip"), start=2):
        press(page, name, how)
        next_pair(page, number)
        # With a mouse the pointer still rests on what was pressed.
        assert page.evaluate(LOOK) == before


def test_after_a_touch_the_next_pair_looks_as_the_first_one_did(
    touched: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(touched, f"{server.url}/s/small")
    before = touched.evaluate(LOOK)
    expect_both_sides_alike(before["looks"])
    for number, name in enumerate(("answer-left", "answer-right", "skip"), start=2):
        press(touched, name, "touch")
        next_pair(touched, number)
        assert touched.evaluate(LOOK) == before


def test_the_next_pair_begins_at_the_top_whichever_was_scrolled_to(
    touched: Page, serve: Serve
) -> None:
    touched.set_viewport_size({"width": 360, "height": 420})
    server = serve(SMALL_PLAN)
    enter_small(touched, f"{server.url}/s/small")
    touched.get_by_test_id("answer-right").scroll_into_view_if_needed()
    assert touched.evaluate("scrollY") > 0
    press(touched, "answer-right", "touch")
    next_pair(touched, 2)
    assert touched.evaluate("scrollY") == 0


def test_the_pair_that_comes_back_by_undo_shows_no_trace_either(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN + "query: {undo_s: 20}\n")
    enter_small(page, f"{server.url}/s/small")
    before = page.evaluate(LOOK)
    press(page, "answer-right", "mouse")
    next_pair(page, 2)
    page.get_by_test_id("undo").click()
    next_pair(page, 1)
    assert page.evaluate(LOOK) == before
