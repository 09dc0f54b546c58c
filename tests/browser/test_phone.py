"""A phone: small, touched, held either way, and with its own mind about when videos may play."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, FloatRect, Page, Playwright, expect

from .evaluator import watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_faults import stored_responses

PORTRAIT = {"width": 390, "height": 844}
LANDSCAPE = {"width": 844, "height": 390}

#: As phones do that save power: nothing plays unless it is asked for in the very task of a touch.
ONLY_IN_A_TOUCH = """(() => {
    let touched = false;
    document.addEventListener("click", () => {
        touched = true;
        setTimeout(() => { touched = false; });
    }, true);
    const play = HTMLMediaElement.prototype.play;
    HTMLMediaElement.prototype.play = function () {
        return touched
            ? play.call(this)
            : Promise.reject(new DOMException("The request is not allowed.", "NotAllowedError"));
    };
})()"""

PARTS = ("video-left", "video-right", "answer-left", "skip", "answer-right")


@pytest.fixture
def phone(playwright: Playwright, browser: Browser) -> Iterator[Page]:
    described: dict[str, Any] = {**playwright.devices["iPhone 13"], "viewport": PORTRAIT}
    del described["default_browser_type"]
    context = browser.new_context(**described)
    page = context.new_page()
    page.add_init_script(ONLY_IN_A_TOUCH)
    yield page
    context.close()


def boxes(page: Page) -> dict[str, FloatRect]:
    found = {name: page.get_by_test_id(name).bounding_box() for name in PARTS}
    return {name: box for name, box in found.items() if box is not None}


def expect_everything_in_sight(page: Page, size: dict[str, int]) -> None:
    """Both videos and every answer are on the screen at once, large enough for a finger."""
    for name, box in boxes(page).items():
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= size["width"], name
        assert box["y"] >= 0, name
        assert box["y"] + box["height"] <= size["height"], name
        assert min(box["width"], box["height"]) >= 44, name
    assert page.evaluate("() => document.documentElement.scrollWidth") <= size["width"]


def test_a_phone_that_lets_nothing_play_by_itself_takes_part_by_touch(
    phone: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    phone.goto(f"{server.url}/s/small")
    phone.get_by_test_id("consent").tap()
    phone.get_by_test_id("continue").tap()
    start = phone.get_by_test_id("start")
    expect(start).to_be_visible()
    expect(phone.get_by_test_id("answer-left")).to_be_disabled()
    expect_everything_in_sight(phone, PORTRAIT)
    start.tap()
    watch(phone)
    for name in ("video-left", "video-right"):
        video = phone.get_by_test_id(name)
        assert video.evaluate("(video) => [video.muted, video.playsInline]") == [True, True]

    phone.get_by_test_id("answer-left").tap()
    expect(phone.get_by_test_id("progress")).to_have_text("Part 1 of 1 · Pair 2 of 4")
    # The touch of the answer is over once the next pair is there: it wants one of its own.
    start.tap()
    watch(phone)
    assert stored_responses(server) == ["left"]


def test_a_phone_held_sideways_shows_both_videos_and_every_answer(
    phone: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    phone.goto(f"{server.url}/s/small")
    phone.get_by_test_id("consent").tap()
    phone.get_by_test_id("continue").tap()
    phone.set_viewport_size({"width": LANDSCAPE["width"], "height": LANDSCAPE["height"]})
    expect(phone.get_by_test_id("start")).to_be_visible()
    phone.get_by_test_id("start").tap()
    watch(phone)
    expect_everything_in_sight(phone, LANDSCAPE)
