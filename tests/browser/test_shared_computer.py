"""A browser that keeps no cookies, and one that several people use, as they see it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, Playwright, expect

from .conftest import ARGUMENTS, PATIENCE_MS, chromium
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN
from .test_leaving import rows

Serve = Callable[..., Server]

PLAN = SMALL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1")
CONSENT = "Before you take part"


@pytest.fixture
def without_cookies(playwright: Playwright, tmp_path: Path) -> Iterator[BrowserContext]:
    """A browser whose settings block cookies."""
    profile = tmp_path / "profile"
    (profile / "Default").mkdir(parents=True)
    blocked = {"profile": {"default_content_setting_values": {"cookies": 2}}}
    (profile / "Default" / "Preferences").write_text(json.dumps(blocked))
    context = playwright.chromium.launch_persistent_context(
        profile, executable_path=chromium(), args=ARGUMENTS, headless=True
    )
    context.set_default_timeout(PATIENCE_MS)
    yield context
    context.close()


def at(page: Page, title: str) -> None:
    expect(page.get_by_role("heading", level=1)).to_have_text(title)


@pytest.mark.parametrize("width", [360, 1440])
def test_a_browser_that_blocks_cookies_is_told_what_to_do(
    without_cookies: BrowserContext, serve: Serve, width: int
) -> None:
    server = serve(PLAN)
    page = without_cookies.new_page()
    page.set_viewport_size({"width": width, "height": 800})
    page.goto(f"{server.url}/s/small")
    for _ in range(2):
        page.get_by_test_id("consent").click()
        at(page, "This browser keeps no cookies")
        assert violations(page) == []
        page.get_by_test_id("try-again").click()
        at(page, CONSENT)
    assert rows(server, "sessions") == 0


@pytest.mark.parametrize("width", [360, 1440])
def test_the_next_person_at_a_computer_sees_no_receipt_and_begins_anew(
    page: Page, serve: Serve, width: int
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    server = serve(PLAN)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    expect(page.get_by_test_id("receipt")).to_be_visible()
    page.get_by_test_id("withdraw").click()
    page.get_by_test_id("withdraw-confirm").click()
    at(page, "You have stopped")
    receipt = page.get_by_test_id("receipt").inner_text()
    page.reload()
    assert page.get_by_test_id("receipt").inner_text() == receipt
    assert violations(page) == []

    page.goto(f"{server.url}/s/small")
    at(page, "You have stopped")
    assert receipt not in page.content()
    page.get_by_test_id("somebody-else").click()
    at(page, "Is it you?")
    assert violations(page) == []
    page.get_by_test_id("it-is-me").click()
    at(page, "You have stopped")
    assert receipt not in page.content()
    page.goto(f"{server.url}/s/small/delete")
    assert receipt not in page.content()
    assert page.get_by_label("Receipt code").input_value() == ""

    page.goto(f"{server.url}/s/small/not-you")
    page.get_by_test_id("begin-anew").click()
    at(page, CONSENT)
    page.get_by_test_id("consent").click()
    expect(page.get_by_test_id("receipt")).not_to_have_text(re.escape(receipt))
    assert rows(server, "sessions") == 2
    # Left in the middle: whoever comes next finds the way out on every page.
    page.goto(f"{server.url}/s/small")
    assert page.get_by_test_id("receipt").count() == 0
    page.get_by_test_id("not-you").click()
    page.get_by_test_id("begin-anew").click()
    at(page, CONSENT)
