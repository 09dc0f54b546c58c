"""Watching a study in a real browser: a session moves live, figures are drawn, for everyone."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository

from .big_study import fill
from .conftest import EMAIL, PASSWORD
from .evaluator import answer, enter_small
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN

WATCHED_PLAN = SMALL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 12")

#: A stream that is open must not keep a server that was told to stop; uvicorn waits for ten.
MOST_SECONDS_TO_STOP = 8.0


def put_sessions_and_account(server: Server, sessions: int) -> None:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    accounts.create(app, EMAIL, PASSWORD)
    if sessions:
        fill(app, repository.find(app, "small"), sessions)
    app.close()


def sign_in(page: Page, server: Server) -> None:
    page.goto(f"{server.url}/sign-in")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    page.wait_for_url("**/studies")


def complaints(page: Page) -> list[str]:
    """What the console says of faults and of what the page's policy refused, as it goes on."""
    heard: list[str] = []
    page.on("console", lambda said: heard.extend([said.text] if said.type == "error" else []))
    page.on("pageerror", lambda error: heard.append(str(error)))
    return heard


def test_a_session_moves_live_on_the_page_of_who_watches(
    browser: Browser, page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(WATCHED_PLAN)
    put_sessions_and_account(server, 0)
    heard = complaints(page)
    sign_in(page, server)
    page.goto(f"{server.url}/studies/small")
    expect(page.get_by_test_id("live")).to_contain_text("Live")
    expect(page.get_by_text("No live session yet.")).to_be_visible()
    # What somebody has the focus on, and has scrolled to, stays while all around it changes.
    page.get_by_test_id("export-zip").focus()

    evaluators = browser.new_context()
    evaluator = evaluators.new_page()
    enter_small(evaluator, f"{server.url}/s/small")
    row = page.get_by_test_id("sessions").locator("tbody tr")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("query 1 of 12")
    answer(evaluator, "left", by="button")
    expect(row).to_contain_text("query 2 of 12")
    expect(page.get_by_test_id("counts")).to_contain_text("Active1")
    expect(page.get_by_test_id("funnel").locator("tbody tr").nth(2)).to_contain_text("1")
    expect(page.get_by_test_id("export-zip")).to_be_focused()

    row.get_by_role("link").click()
    expect(page.get_by_test_id("queries").locator("li")).to_have_count(2)
    thumb = page.get_by_test_id("queries").get_by_role("button").first
    thumb.scroll_into_view_if_needed()
    thumb.hover()
    page.wait_for_function("() => [...document.querySelectorAll('video')].some((v) => !v.paused)")
    page.mouse.move(0, 0)
    page.wait_for_function("() => [...document.querySelectorAll('video')].every((v) => v.paused)")
    assert heard == []

    page.go_back()
    expect(page.get_by_test_id("live")).to_contain_text("Live")
    began = time.monotonic()
    server.stop()
    assert time.monotonic() - began < MOST_SECONDS_TO_STOP
    expect(page.get_by_test_id("live")).to_contain_text("Connecting again")
    server.start()
    expect(page.get_by_test_id("live")).to_contain_text("Live: this page follows")
    evaluators.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_figures_are_drawn_and_every_page_is_for_everyone(
    browser: Browser, serve: Callable[[str], Server], scheme: str
) -> None:
    server = serve(WATCHED_PLAN)
    put_sessions_and_account(server, 20)
    context = browser.new_context(
        color_scheme="dark" if scheme == "dark" else "light",
        viewport={"width": 1440, "height": 900},
    )
    page = context.new_page()
    heard = complaints(page)
    sign_in(page, server)
    for path in ("", "/results", "/sessions/s00001"):
        page.goto(f"{server.url}/studies/small{path}")
        figures = page.locator("[data-figure]")
        for index in range(figures.count()):
            figures.nth(index).scroll_into_view_if_needed()
            expect(figures.nth(index)).to_have_attribute("data-drawn", "yes")
        if path == "/results":
            assert page.locator("[data-chart] canvas").count() == 6
            point_at_a_dot(page)
        assert violations(page) == []
        width = page.evaluate("() => document.documentElement.scrollWidth")
        assert width <= 1440
    assert heard == []
    context.close()


def point_at_a_dot(page: Page) -> None:
    """The mouse over a chart tells the value there."""
    canvas = page.get_by_test_id("figure-win-rates").locator("canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    assert box is not None
    tooltip = page.locator("#vg-tooltip-element.visible")
    for across in range(60, int(box["width"]), 6):
        for down in range(20, int(box["height"]) - 30, 6):
            page.mouse.move(box["x"] + across, box["y"] + down)
            if tooltip.count():
                expect(tooltip).to_contain_text("value")
                page.mouse.move(0, 0)
                expect(tooltip).to_have_count(0)
                return
    raise AssertionError("expected a dot that tells its value, found none")


@pytest.mark.parametrize("lacks", ["AbortSignal.timeout", "AbortController", "EventSource"])
def test_a_browser_that_lacks_something_follows_a_study_all_the_same(
    page: Page, browser: Browser, serve: Callable[[str], Server], lacks: str
) -> None:
    server = serve(WATCHED_PLAN)
    put_sessions_and_account(server, 0)
    sign_in(page, server)
    page.add_init_script(f"window.{lacks} = undefined")
    page.goto(f"{server.url}/studies/small")
    says = page.locator("[data-live-says]")
    expect(says).to_contain_text("fetched" if lacks == "EventSource" else "Live")
    evaluator = browser.new_context().new_page()
    enter_small(evaluator, f"{server.url}/s/small")
    answer(evaluator, "left", by="key")
    expect(page.get_by_test_id("counts")).to_contain_text("1")
    expect(page.locator("[data-live-reload]")).to_be_hidden()
    evaluator.context.close()
