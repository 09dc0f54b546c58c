"""The settings of the query page, as an evaluator lives through them."""

from __future__ import annotations

from collections.abc import Callable

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from app.services.settings import Settings
from app.services.studio import open_studio
from app.storage.tables import Response

from .evaluator import enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN

REASONS_PLAN = SMALL_PLAN.replace(
    "skip: {label: I don't like either.}",
    "skip:\n      label: I don't like either.\n"
    "      reasons: {both_bad: Both are bad, cannot_tell: I cannot tell}",
)
WATCH_PLAN = SMALL_PLAN + "query: {watch_once: true}\n"

Serve = Callable[[str], Server]


def responses(server: Server) -> list[tuple[str, str | None]]:
    studio = open_studio(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with studio.database.read() as session:
            rows = session.query(Response).order_by(Response.id)
            return [(row.response, row.skip_reason) for row in rows]
    finally:
        studio.close()


def at_query(page: Page, number: int) -> None:
    expect(page.get_by_test_id("progress")).to_have_text(f"Part 1 of 1 · Pair {number} of 4")
    watch(page)


def violations(page: Page) -> list[str]:
    return [found["id"] for found in Axe().run(page).response["violations"]]


def test_a_skip_asks_for_its_reason_and_may_be_taken_back(page: Page, serve: Serve) -> None:
    server = serve(REASONS_PLAN)
    enter_small(page, f"{server.url}/s/small")

    page.get_by_test_id("skip").click()
    expect(page.get_by_role("group", name="Why do you skip this pair?")).to_be_visible()
    assert violations(page) == []
    page.get_by_role("button", name="Back").click()
    page.get_by_test_id("answer-left").click()
    at_query(page, 2)

    page.get_by_test_id("skip").click()
    page.get_by_test_id("reason-cannot_tell").click()
    at_query(page, 3)
    assert responses(server) == [("left", None), ("skip", "cannot_tell")]


def test_a_reason_can_be_given_by_keys_alone(page: Page, serve: Serve) -> None:
    server = serve(REASONS_PLAN)
    enter_small(page, f"{server.url}/s/small")

    page.keyboard.press("ArrowDown")
    expect(page.get_by_test_id("reason-both_bad")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("reason-both_bad")).to_be_hidden()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowRight")
    expect(page.get_by_test_id("reason-cannot_tell")).to_be_focused()
    page.keyboard.press("Enter")
    at_query(page, 2)
    page.keyboard.press("ArrowRight")
    at_query(page, 3)
    assert responses(server) == [("skip", "cannot_tell"), ("right", None)]


def test_buttons_stay_closed_until_both_videos_were_seen_to_their_end(
    page: Page, serve: Serve
) -> None:
    server = serve(WATCH_PLAN)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Watch both videos to the end")
    page.wait_for_function(
        """() => document.querySelector('[data-testid="video-left"]').currentTime > 0.5"""
    )
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_test_id("answer-left")).to_be_disabled()

    expect(page.get_by_test_id("answer-left")).to_be_enabled()
    expect(page.get_by_role("heading", level=1)).to_have_text("Which one is better?")
    page.keyboard.press("ArrowRight")
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 1 · Pair 2 of 4")
    assert responses(server) == [("right", None)]
