"""A video that does not play costs its pair, never an answer and never the session."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import Event, QueryRow, Response

from .evaluator import FIRST_FRAME_MS, answer, enter, enter_small, query_on_screen, watch
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN

#: Slower than any two videos of the crane play (13 to 150 kB/s), and fast enough to begin them.
SLOW_BYTES_PER_S = 12_000


#: Pauses the right video once, when it is seen to play, and notes when it plays on. Inside the
#: page: the time between two looks of a test may be longer than the whole video.
PAUSED_ONCE = """(() => {
    document.addEventListener("timeupdate", ({ target }) => {
        const isIt = target.dataset?.testid === "video-right";
        if (isIt && !window.paused && target.currentTime > 0.3 && !target.ended) {
            window.paused = true;
            target.pause();
        }
    }, true);
    document.addEventListener("playing", ({ target }) => {
        if (window.paused && target.dataset?.testid === "video-right") {
            window.playsOn = true;
        }
    }, true);
})()"""


def stored(server: Server) -> tuple[list[tuple[int, str | None]], list[str], list[str]]:
    """Each query with its place and fault, the responses, and the names of the events."""
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            queries = db.query(QueryRow).order_by(QueryRow.id)
            return (
                [(query.query_index, query.fault) for query in queries],
                [response.response for response in db.query(Response)],
                [event.event for event in db.query(Event).order_by(Event.id)],
            )
    finally:
        app.close()


def test_a_pair_that_is_said_not_to_play_is_replaced_and_the_place_stays(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    before = page.get_by_test_id("video-left").evaluate("(video) => video.currentSrc")
    page.get_by_test_id("fault").click()
    expect(page.get_by_text("Here is another one")).to_be_visible()
    watch(page)
    assert page.get_by_test_id("video-left").evaluate("(video) => video.currentSrc") != before
    assert query_on_screen(page) == "Part 1 of 1 · Pair 1 of 4"
    answer(page, "left", by="key")

    queries, responses, events = stored(server)
    assert queries[:2] == [(0, "pressed; left: ready; right: ready"), (0, None)]
    assert responses == ["left"]
    assert events.count("set_aside") == 1


def test_a_video_that_the_server_lacks_is_replaced_without_a_press(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    session = page.request.get(f"{server.url}/api/v1/session", headers={"PBPO-Study": "small"})
    gone = f"**{session.json()['query']['left']['url']}"
    page.route(gone, lambda route: route.fulfill(status=404, body="{}"))
    page.context.new_cdp_session(page).send("Network.clearBrowserCache")
    page.reload()
    expect(page.get_by_text("Here is another one")).to_be_visible(timeout=FIRST_FRAME_MS)
    watch(page)
    queries, _, _ = stored(server)
    assert "left video is missing" in str(queries[0][1])
    assert queries[1:] == [(0, None)]


def test_a_pair_that_halts_on_a_slow_line_says_so_and_plays_on_together(
    page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    watch(page)
    line = page.context.new_cdp_session(page)
    line.send("Network.enable")
    conditions = {"offline": False, "latency": 20, "uploadThroughput": -1}
    slow = {**conditions, "downloadThroughput": SLOW_BYTES_PER_S}
    line.send("Network.emulateNetworkConditions", slow)
    line.send("Network.clearBrowserCache")
    page.reload()
    expect(page.get_by_text("Waiting for the video").first).to_be_visible(timeout=FIRST_FRAME_MS)
    line.send("Network.emulateNetworkConditions", {**conditions, "downloadThroughput": -1})
    expect(page.get_by_text("Waiting for the video")).to_have_count(0)
    watch(page)
    apart = page.evaluate(
        """() => Math.abs(document.querySelector('[data-testid="video-left"]').currentTime
            - document.querySelector('[data-testid="video-right"]').currentTime)"""
    )
    assert apart < 0.3
    answer(page, "right", by="key")
    _, responses, events = stored(server)
    assert responses == ["right"]
    assert {"stall", "recovered"} <= set(events)


def test_where_no_video_can_play_the_page_says_what_may_help_and_leads_out(
    page: Page, serve: Callable[[str], Server]
) -> None:
    codes = "{completed: DONE-1, technical: BROKEN-1}"
    server = serve(SMALL_PLAN + f"recruitment: {{platform: prolific, codes: {codes}}}\n")
    enter_small(page, f"{server.url}/s/small?PROLIFIC_PID=5f0c")
    page.route("**/media/**", lambda route: route.abort())
    page.context.new_cdp_session(page).send("Network.clearBrowserCache")
    page.reload()
    for _ in range(2):
        page.wait_for_timeout(1000)
        page.get_by_test_id("fault").click()
        expect(page.get_by_text("Here is another one")).to_be_visible()
    page.wait_for_timeout(1000)
    page.get_by_test_id("fault").click()
    expect(page.get_by_text("No video plays here.")).to_be_visible()
    expect(page.get_by_text("Here is another one")).to_be_hidden()
    page.unroute("**/media/**")
    watch(page)
    expect(page.get_by_text("No video plays here.")).to_be_hidden()
    page.route("**/media/**", lambda route: route.abort())
    page.context.new_cdp_session(page).send("Network.clearBrowserCache")
    page.reload()
    for _ in range(3):
        page.wait_for_timeout(1000)
        page.get_by_test_id("fault").click()
    page.locator("#notice-action").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("The videos do not load")
    expect(page.get_by_text("Try another network")).to_be_visible()
    expect(page.get_by_test_id("completion-code")).to_have_text("BROKEN-1")
    assert violations(page) == []
    page.unroute("**/media/**")
    page.get_by_test_id("try-again").click()
    watch(page)


def test_a_video_that_something_else_pauses_plays_on_with_the_other(
    page: Page, serve: Callable[[str], Server]
) -> None:
    server = serve(SMALL_PLAN + "query: {watch_once: true}\n")
    page.add_init_script(PAUSED_ONCE)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    page.wait_for_function("() => window.playsOn")
    expect(page.get_by_test_id("answer-left")).to_be_enabled()
    answer(page, "left", by="key")
    _, responses, events = stored(server)
    assert responses == ["left"]
    assert "halted" in events
