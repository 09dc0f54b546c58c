"""When something goes wrong, nothing is lost and the evaluator is in no doubt."""

from __future__ import annotations

from playwright.sync_api import BrowserContext, Page, Request, Route, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import QueryRow, Response

from .evaluator import answer, enter, query_on_screen, watch
from .server import Server


def stored_responses(server: Server) -> list[str]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            rows = db.query(Response.response).join(QueryRow).order_by(QueryRow.id)
            return [response for (response,) in rows]
    finally:
        app.close()


def test_a_killed_server_brings_the_evaluator_back_to_the_very_query(
    page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    answer(page, "left", by="key")
    watch(page)
    before = page.evaluate("() => JSON.parse(document.querySelector('#state').textContent)")
    shown = page.request.get(f"{server.url}/api/v1/session", headers={"PBPO-Study": "short"})
    server.kill()
    server.start()
    again = page.request.get(f"{server.url}/api/v1/session", headers={"PBPO-Study": "short"})

    def pair(state: dict[str, dict[str, object]]) -> list[object]:
        return [state["query"][part] for part in ("id", "left", "right")]

    assert pair(again.json()) == pair(shown.json())
    assert before["stage"] == "query"
    page.reload()
    watch(page)
    assert query_on_screen(page) == "Part 1 of 3 · Pair 2 of 2"
    assert stored_responses(server) == ["left"]


def test_an_answer_given_while_the_server_is_away_is_kept_and_saved_when_it_is_back(
    page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    server.kill()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("Not saved yet")).to_be_visible(timeout=15_000)
    server.start()
    expect(page.get_by_test_id("progress")).to_have_text(
        "Part 1 of 3 · Pair 2 of 2", timeout=30_000
    )
    assert stored_responses(server) == ["right"]


def test_a_double_click_answers_once(page: Page, server: Server) -> None:
    enter(page, f"{server.url}/s/short")
    page.get_by_test_id("answer-left").dblclick()
    watch(page)
    page.wait_for_timeout(500)
    assert query_on_screen(page) == "Part 1 of 3 · Pair 2 of 2"
    assert stored_responses(server) == ["left"]


def test_a_second_tab_that_is_behind_is_brought_to_where_the_session_is(
    context: BrowserContext, page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    second = context.new_page()
    second.goto(f"{server.url}/s/short")
    second.bring_to_front()
    watch(second)
    answer(second, "left", by="key")
    page.bring_to_front()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 3 · Pair 2 of 2")
    assert stored_responses(server) == ["left"]


def test_a_stale_answer_of_a_second_tab_is_said_to_be_too_late(
    context: BrowserContext, page: Page, server: Server
) -> None:
    enter(page, f"{server.url}/s/short")
    page.evaluate("Object.defineProperty(document, 'visibilityState', { get: () => 'hidden' })")
    second = context.new_page()
    second.goto(f"{server.url}/s/short")
    watch(second)
    answer(second, "left", by="key")
    page.bring_to_front()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("This pair was already answered in another tab.")).to_be_visible()
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 3 · Pair 2 of 2")
    assert stored_responses(server) == ["left"]
    # Beyond the last pair of a part the page says so before it goes. It is loaded anew: a page
    # that takes itself for hidden does not play on; only its own answer tells it of the other's.
    watch(second)
    page.reload()
    watch(page)
    sent: list[Request] = []
    page.on("request", lambda request: sent.append(request) if request.method == "POST" else None)
    page.route("**/api/v1/session", lambda route: route.continue_() if sent else route.abort())
    second.keyboard.press("ArrowLeft")
    expect(second.get_by_role("heading", level=1)).to_have_text("Take a break")
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("This pair was already answered in another tab.")).to_be_visible()
    expect(page.get_by_role("heading", level=1)).to_have_text("Take a break")
    assert stored_responses(server) == ["left", "left"]


def test_a_video_that_fails_to_load_says_so_and_recovers(page: Page, server: Server) -> None:
    broken = True

    def sometimes(route: Route) -> None:
        if broken:
            route.abort()
        else:
            route.continue_()

    page.goto(f"{server.url}/s/short")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    page.route("**/media/**", sometimes)
    page.get_by_test_id("continue").click()
    expect(page.get_by_text("This video did not load").first).to_be_visible(timeout=20_000)
    expect(page.get_by_test_id("answer-left")).to_be_disabled()
    broken = False
    watch(page)


def test_going_back_and_reloading_changes_nothing(page: Page, server: Server) -> None:
    enter(page, f"{server.url}/s/short")
    answer(page, "left", by="mouse")
    page.go_back()
    page.goto(f"{server.url}/s/short")
    watch(page)
    page.reload()
    watch(page)
    assert query_on_screen(page) == "Part 1 of 3 · Pair 2 of 2"
    assert stored_responses(server) == ["left"]
