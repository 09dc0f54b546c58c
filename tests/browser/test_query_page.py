"""The settings of the query page, as an evaluator lives through them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import Event, Response

from .evaluator import answer, enter_small, watch
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN

REASONS_PLAN = SMALL_PLAN.replace(
    "skip: {label: I don't like either.}",
    "skip:\n      label: I don't like either.\n"
    "      reasons: {both_bad: Both are bad, cannot_tell: I cannot tell}",
)
#: Presses for the left video while it plays, before it can have been seen to its end, and notes
#: whether that could be chosen. Inside the page: a video is shorter than a busy machine's pause.
PRESS_MEANWHILE = """document.addEventListener("timeupdate", ({ target }) => {
    if (target.dataset?.testid === "video-left" && target.currentTime > 1 && !window.pressed) {
        const button = document.querySelector('[data-testid="answer-left"]');
        window.pressed = { closed: button.getAttribute("aria-disabled") === "true" };
        const key = { key: "ArrowLeft", bubbles: true, cancelable: true };
        document.activeElement.dispatchEvent(new KeyboardEvent("keydown", key));
    }
}, true)"""
#: Widths of both videos, and how many pixels of each the panel of reasons covers.
OVERLAPS = """() => {
    const panel = document.querySelector("#reasons").getBoundingClientRect();
    const boxes = ["left", "right"].map((side) =>
        document.querySelector(`.player[data-side="${side}"]`).getBoundingClientRect());
    const shared = (one, other, from, to) =>
        Math.max(0, Math.min(one[to], other[to]) - Math.max(one[from], other[from]));
    return [
        boxes.map(({ width }) => Math.round(width)),
        boxes.map((box) =>
            shared(box, panel, "left", "right") * shared(box, panel, "top", "bottom")),
    ];
}"""
WATCH_PLAN = SMALL_PLAN + "query: {watch_once: true}\n"

Serve = Callable[[str], Server]


def responses(server: Server) -> list[tuple[str, str | None]]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            rows = db.query(Response).order_by(Response.id)
            return [(row.response, row.skip_reason) for row in rows]
    finally:
        app.close()


def enlarged_events(server: Server) -> list[str | None]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            rows = db.query(Event).filter_by(event="fullscreen").order_by(Event.id)
            return [row.value for row in rows]
    finally:
        app.close()


def at_query(page: Page, number: int) -> None:
    expect(page.get_by_test_id("progress")).to_have_text(f"Part 1 of 1 · Pair {number} of 4")
    watch(page)


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

    # It covers neither video, whatever the page looks like, and both keep one size.
    page.get_by_test_id("skip").click()
    for width, height in ((1280, 800), (360, 740), (740, 360)):
        page.set_viewport_size({"width": width, "height": height})
        sizes, covered = page.evaluate(OVERLAPS)
        assert sizes[0] == sizes[1], width
        assert covered == [0, 0], width
    page.set_viewport_size({"width": 1280, "height": 800})
    # Choosing stays possible.
    page.get_by_test_id("answer-right").click()
    at_query(page, 4)
    expect(page.get_by_role("group", name="Why do you skip this pair?")).to_be_hidden()
    assert responses(server) == [("left", None), ("skip", "cannot_tell"), ("right", None)]


def test_a_reason_can_be_given_by_keys_alone(page: Page, serve: Serve) -> None:
    server = serve(REASONS_PLAN)
    enter_small(page, f"{server.url}/s/small")

    page.keyboard.press("ArrowDown")
    expect(page.get_by_role("group", name="Why do you skip this pair?")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("reason-both_bad")).to_be_hidden()
    page.keyboard.press("ArrowDown")
    # Their order is drawn for each session.
    reasons = page.locator("[data-reasons] button")
    page.keyboard.press("ArrowDown")
    expect(reasons.nth(0)).to_be_focused()
    page.keyboard.press("ArrowRight")
    expect(reasons.nth(1)).to_be_focused()
    name = (reasons.nth(1).get_attribute("data-testid") or "").removeprefix("reason-")
    page.keyboard.press("Enter")
    at_query(page, 2)
    page.keyboard.press("ArrowRight")
    at_query(page, 3)
    assert responses(server) == [("skip", name), ("right", None)]


def test_no_reason_is_given_by_the_key_that_asked_for_it(page: Page, serve: Serve) -> None:
    server = serve(REASONS_PLAN)
    enter_small(page, f"{server.url}/s/small")
    for key in ("ArrowDown", "Enter"):
        if key == "Enter":
            page.get_by_test_id("skip").focus()
        page.keyboard.down(key)
        page.keyboard.down(key)  # held: the browser repeats it
        page.keyboard.up(key)
        page.keyboard.press("Space")
        page.keyboard.press("Enter")
        expect(page.get_by_role("group", name="Why do you skip this pair?")).to_be_visible()
        page.keyboard.press("Escape")
    page.wait_for_timeout(300)
    assert responses(server) == []


def test_buttons_stay_closed_until_both_videos_were_seen_to_their_end(
    page: Page, serve: Serve
) -> None:
    server = serve(WATCH_PLAN)
    page.add_init_script(PRESS_MEANWHILE)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Watch both to the end")
    page.wait_for_function("() => window.pressed")
    assert page.evaluate("() => window.pressed.closed")

    expect(page.get_by_test_id("answer-left")).to_be_enabled()
    expect(page.get_by_role("heading", level=1)).to_have_text("Which video is better?")
    page.keyboard.press("ArrowRight")
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 1 · Pair 2 of 4")
    assert responses(server) == [("right", None)]


def test_an_answer_can_be_undone_for_some_seconds(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN + "query: {undo_s: 4}\n")
    enter_small(page, f"{server.url}/s/small")
    expect(page.get_by_test_id("undo")).to_be_hidden()
    answer(page, "left", by="key")
    page.get_by_test_id("undo").click()
    at_query(page, 1)
    assert responses(server) == []

    page.keyboard.press("ArrowRight")
    at_query(page, 2)
    expect(page.get_by_test_id("undo")).to_be_hidden(timeout=8_000)
    page.keyboard.press("ArrowLeft")
    at_query(page, 3)
    assert responses(server) == [("right", None), ("left", None)]


@pytest.mark.parametrize("has_fullscreen", [True, False])
def test_both_videos_can_be_enlarged_and_answered_as_before(
    page: Page, serve: Serve, has_fullscreen: bool
) -> None:
    if not has_fullscreen:
        page.add_init_script("delete Element.prototype.requestFullscreen")
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    enlarge = page.get_by_test_id("enlarge")
    enlarge.click()
    expect(enlarge).to_have_attribute("aria-pressed", "true")
    assert page.evaluate("document.fullscreenElement !== null") is has_fullscreen
    expect(page.get_by_text("Debrief")).to_be_hidden()
    expect(page.get_by_test_id("withdraw")).to_be_visible()
    expect(page.get_by_test_id("answer-left")).to_be_in_viewport()
    assert violations(page) == []
    page.keyboard.press("ArrowLeft")
    at_query(page, 2)
    expect(enlarge).to_have_attribute("aria-pressed", "true")

    if has_fullscreen:
        enlarge.click()
    else:
        page.keyboard.press("Escape")
    expect(enlarge).to_have_attribute("aria-pressed", "false")
    expect(page.get_by_text("Debrief")).to_be_visible()
    page.keyboard.press("ArrowRight")
    at_query(page, 3)
    assert enlarged_events(server) == ["1", "1", "0"]
