"""Browsers that lack something: answers go by what they have; the first page says what cannot."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import Event, Response

from .evaluator import answer, enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_faults import stored_responses

Serve = Callable[[str], Server]

#: Taken away one by one: what some browser since Safari 15.4, Firefox 91 and Chrome 92 lacked.
FEATURES = (
    "AbortSignal.timeout",
    "AbortSignal.any",
    "AbortController",
    "AbortSignal",
    "fetch",
    "Request",
    "Headers",
    "XMLHttpRequest",
    "localStorage",
    "sessionStorage",
    "indexedDB",
    "performance",
    "matchMedia",
    "visualViewport",
    "ResizeObserver",
    "IntersectionObserver",
    "EventSource",
    "structuredClone",
    "queueMicrotask",
    "scrollTo",
    "Blob",
    "URL",
    "URL.createObjectURL",
    "URL.revokeObjectURL",
    "Intl",
    "Promise.any",
    "Promise.allSettled",
    "Object.hasOwn",
    "Object.fromEntries",
    "Array.prototype.at",
    "Array.prototype.findLast",
    "String.prototype.replaceAll",
    "crypto.randomUUID",
    "navigator.sendBeacon",
    "History.prototype.scrollRestoration",
    "Element.prototype.replaceChildren",
    "Element.prototype.requestFullscreen",
    "HTMLVideoElement.prototype.requestVideoFrameCallback",
    "HTMLVideoElement.prototype.getVideoPlaybackQuality",
    "HTMLMediaElement.prototype.played",
    "HTMLFormElement.prototype.requestSubmit",
    "SubmitEvent",
    "HTMLDialogElement",
)

TAKE_AWAY = """(() => {
    const path = "FEATURE".split(".");
    const last = path.pop();
    const holder = path.reduce((value, name) => value[name], window);
    Object.defineProperty(holder, last, { value: undefined, configurable: true, writable: true });
})()"""


def stored_events(server: Server) -> list[str]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            return [row.event for row in db.query(Event).order_by(Event.id)]
    finally:
        app.close()


def times(server: Server) -> list[float | None]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            return [row.rt_ms for row in db.query(Response).order_by(Response.id)]
    finally:
        app.close()


# Three sessions, which may run side by side.
@pytest.mark.parametrize("features", [FEATURES[start::3] for start in range(3)])
def test_whatever_a_browser_lacks_an_answer_is_stored(
    context: BrowserContext, page: Page, serve: Serve, features: tuple[str, ...]
) -> None:
    server = serve(
        SMALL_PLAN.replace("queries_per_trial: 4", f"queries_per_trial: {len(features)}")
    )
    enter_small(page, f"{server.url}/s/small")
    page.close()
    for number, feature in enumerate(features, start=1):
        page = context.new_page()
        page.add_init_script(TAKE_AWAY.replace("FEATURE", feature))
        page.goto(f"{server.url}/s/small")
        expect(page.get_by_test_id("answer-left"), feature).to_be_enabled()
        page.get_by_test_id("answer-left").click()
        if number < len(features):
            shown = expect(page.get_by_test_id("progress"), feature)
            shown.to_contain_text(f"Pair {number + 1} of {len(features)}")
            expect(page.get_by_text("Not saved yet"), feature).to_be_hidden()
        else:
            expect(page.get_by_test_id("answer-left"), feature).to_be_hidden()
        page.close()
    assert stored_responses(server) == ["left"] * len(features)


def test_a_mistake_of_ours_is_no_broken_line_and_the_answer_is_sent_all_the_same(
    page: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    mistake = "JSON.stringify = () => { throw new TypeError('a mistake') }"
    page.evaluate(f"setTimeout(() => {{ {mistake} }})")
    page.get_by_test_id("answer-right").click()
    expect(page.get_by_test_id("progress")).to_contain_text("Pair 2 of 4")
    watch(page)
    answer(page, "left", by="key")
    watch(page)
    assert stored_responses(server) == ["right", "left"]
    assert stored_events(server).count("sent_by_form") == 1
    assert all(taken is not None and taken >= 700 for taken in times(server))


def test_a_request_that_cannot_be_made_is_told_from_a_broken_line(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN)
    page.goto(f"{server.url}/s/small")
    outcome = """async (options) => {
        const { Unreachable, request } = await import("/static/js/request.js");
        try {
            await request("/api/v1/session", options, 2000);
        } catch (error) {
            return error instanceof Unreachable ? "unreachable" : "mistake";
        }
        return "answered";
    }"""
    assert page.evaluate(outcome, {"method": "GET"}) == "answered"
    assert page.evaluate(outcome, {"method": "NOT A METHOD"}) == "mistake"
    page.evaluate("window.fetch = undefined")
    assert page.evaluate(outcome, {"method": "GET"}) == "mistake"
    page.reload()
    page.route("**/api/**", lambda route: route.abort())
    assert page.evaluate(outcome, {"method": "GET"}) == "unreachable"


@pytest.mark.parametrize("script", ["outbox.js", "query.js", "i18n.js"])
def test_where_a_script_of_ours_does_not_load_the_page_says_so_and_takes_the_answer(
    page: Page, serve: Serve, script: str
) -> None:
    server = serve(SMALL_PLAN)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    broken = True
    page.route(f"**/{script}", lambda route: route.abort() if broken else route.continue_())
    page.get_by_test_id("continue").click()
    expect(page.get_by_test_id("failure")).to_be_visible()
    expect(page.get_by_text("Not saved yet")).to_be_hidden()
    expect(page.get_by_test_id("answer-left")).to_be_disabled()
    page.get_by_test_id("start").click()
    expect(page.get_by_test_id("answer-left")).to_be_enabled()
    page.get_by_test_id("answer-left").click()
    expect(page.get_by_test_id("progress")).to_contain_text("Pair 2 of 4")
    broken = False
    page.reload()
    expect(page.get_by_test_id("failure")).to_be_hidden()
    watch(page)
    assert stored_responses(server) == ["left"]
    assert all(taken is not None and taken >= 700 for taken in times(server))


def test_a_script_that_fails_while_a_pair_comes_brings_that_pair_as_a_new_page(
    page: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.evaluate("document.querySelector('#progress-bar').remove(); window.setTimeout = undefined")
    page.get_by_test_id("answer-left").click()
    expect(page.get_by_test_id("progress")).to_contain_text("Pair 2 of 4")
    watch(page)
    assert stored_responses(server) == ["left"]


def test_a_browser_without_cascade_layers_shows_a_pair_all_the_same(
    page: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    page.add_init_script("delete window.CSSLayerBlockRule")
    # As such a browser reads it: it drops every layer.
    page.route("**/app.css", lambda route: route.fulfill(content_type="text/css", body=""))
    enter_small(page, f"{server.url}/s/small")
    for width, height in ((1280, 800), (360, 740), (320, 640)):
        page.set_viewport_size({"width": width, "height": height})
        left, right = (page.get_by_test_id(f"video-{s}").bounding_box() for s in ("left", "right"))
        assert left
        assert right
        assert left["width"] == right["width"]
        assert (left["y"] == right["y"]) is (width > 1000)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.get_by_test_id("answer-left").click()
    expect(page.get_by_test_id("progress")).to_contain_text("Pair 2 of 4")


def abort(route: Route) -> None:
    route.abort()


@pytest.mark.parametrize("welcome", [False, True])
def test_the_first_page_says_what_a_browser_lacks(page: Page, serve: Serve, welcome: bool) -> None:
    server = serve(SMALL_PLAN)
    url = f"{server.url}/s/small"
    page.goto(url)
    page.wait_for_function("() => document.documentElement.dataset.modules === 'ready'")
    expect(page.get_by_test_id("browser-support")).to_be_hidden()

    page.add_init_script("CSS.supports = (name) => name !== 'aspect-ratio'")
    page.goto(url)
    expect(page.get_by_test_id("browser-support")).to_contain_text("side by side")
    expect(page.get_by_test_id("browser-support").get_by_role("listitem")).to_have_count(1)

    page.add_init_script("HTMLMediaElement.prototype.canPlayType = () => ''")
    page.route("**/synced_pair.js", abort)
    page.goto(url)
    expect(page.get_by_test_id("browser-support").get_by_role("listitem")).to_have_count(3)
    expect(page.get_by_test_id("consent")).to_be_visible()


@pytest.mark.parametrize(("form", "other"), [("webm", "mp4"), ("mp4", "webm")])
def test_the_first_page_asks_for_the_formats_of_the_studys_videos_alone(
    page: Page, serve: Callable[..., Server], form: str, other: str
) -> None:
    server = serve(SMALL_PLAN, frames=(2,), form=form)
    page.add_init_script(
        f"""HTMLMediaElement.prototype.canPlayType =
            (type) => type.startsWith("video/" + (window.lacks ?? "{other}")) ? "" : "maybe";"""
    )
    page.goto(f"{server.url}/s/small")
    page.wait_for_function("() => document.documentElement.dataset.modules === 'ready'")
    notice = page.get_by_test_id("browser-support")
    expect(notice).to_be_hidden()
    page.add_init_script(f"window.lacks = '{form}'")
    page.reload()
    expect(notice.get_by_role("listitem")).to_have_count(1)
    expect(notice).to_contain_text({"mp4": "MP4 with H.264", "webm": "WebM"}[form])


def test_without_scripts_the_first_page_says_so_and_no_pair_is_answered_unseen(
    browser: Browser, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{server.url}/s/small")
    expect(page.get_by_test_id("no-script")).to_be_visible()
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    for name in ("answer-left", "skip", "answer-right"):
        expect(page.get_by_test_id(name)).to_have_attribute("disabled", "")
    context.close()
