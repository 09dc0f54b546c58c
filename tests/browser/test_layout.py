"""What stands beside what on the pages of a session, from the narrowest window to a wide one."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import FloatRect, Page

from .conftest import EMAIL, PASSWORD
from .evaluator import enter_small, watch
from .server import Server
from .small_study import BILINGUAL_PLAN

Serve = Callable[[str], Server]

#: 320 is a window of 1280 at 400 %, which WCAG asks to need no scrolling sideways.
WIDTHS = (320, 360, 768, 1440)


def box(page: Page, selector: str) -> FloatRect:
    found = page.locator(selector).first.bounding_box()
    assert found is not None, selector
    return found


def is_one_line(page: Page, selector: str) -> bool:
    return bool(
        page.locator(selector).first.evaluate(
            "(one) => one.getBoundingClientRect().height"
            " < 1.5 * parseFloat(getComputedStyle(one).lineHeight)"
        )
    )


def expect_no_scrolling_sideways(page: Page, width: int) -> None:
    needed = page.evaluate("document.documentElement.scrollWidth")
    assert needed <= width, f"{needed} px in a window of {width}"


@pytest.mark.parametrize("language", ["en", "ja"])
def test_the_pages_of_a_session_fit_windows_of_every_width(
    page: Page, serve: Serve, language: str
) -> None:
    server = serve(BILINGUAL_PLAN)
    page.goto(f"{server.url}/s/small?lang={language}")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        expect_no_scrolling_sideways(page, width)
    enter_small(page, f"{server.url}/s/small?lang={language}")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        expect_no_scrolling_sideways(page, width)
        assert is_one_line(page, "h1"), width
        header, steps = box(page, ".top"), box(page, ".top nav")
        assert steps["height"] <= header["height"], width
        privacy, not_you = (box(page, f'[data-testid="{name}"]') for name in ("privacy", "not-you"))
        assert not_you["x"] - (privacy["x"] + privacy["width"]) >= 32, width
    query = page.url
    for name in ("privacy", "not-you", "withdraw"):
        page.get_by_test_id(name).click()
        page.wait_for_url(lambda url: url != query)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            expect_no_scrolling_sideways(page, width)
        page.go_back()
        watch(page)


def test_the_banner_of_a_preview_holds_its_buttons(page: Page, server: Server) -> None:
    page.goto(f"{server.url}/sign-in")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    page.wait_for_url("**/studies")
    page.goto(f"{server.url}/studies/short/manage")
    page.get_by_test_id("preview-study").click()
    page.get_by_test_id("consent").wait_for()
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        expect_no_scrolling_sideways(page, width)
        banner, sentence = box(page, ".mode"), box(page, ".mode p")
        button = box(page, ".mode button")
        assert sentence["y"] >= banner["y"] + 4, width
        assert button["y"] >= banner["y"] + 4, width
        assert button["y"] + button["height"] <= banner["y"] + banner["height"] - 4, width
