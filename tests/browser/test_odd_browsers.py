"""Browsers whose clock is wrong, that keep nothing, or that were put to sleep."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import Response, SessionRow

from .evaluator import answer, enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_faults import stored_responses

Serve = Callable[[str], Server]

DAY_MS = 24 * 3600 * 1000

#: A break comes after every pair: longer than a busy machine takes to show it.
BREAK_S = 60
BREAK_PLAN = (
    SMALL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1\ntrials_per_condition: 2")
).replace("break_s: 0", f"break_s: {BREAK_S}")

#: The date of a computer whose clock was set wrong; how long things take is told by another clock.
WRONG_DATE = """(() => {
    const Right = Date;
    Date = class extends Right {
        constructor(...given) { given.length ? super(...given) : super(Right.now() + SHIFT_MS); }
        static now() { return Right.now() + SHIFT_MS; }
    };
})()"""

#: What browsers do that were told to keep nothing.
NO_STORAGE = """(() => {
    for (const name of ["localStorage", "sessionStorage", "indexedDB"]) {
        Object.defineProperty(window, name, {
            get() { throw new DOMException("The operation is insecure.", "SecurityError"); },
        });
    }
})()"""


def reaction_times_s(server: Server) -> list[float]:
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    try:
        with app.database.read() as db:
            return [(row.rt_ms or 0.0) / 1000 for row in db.query(Response)]
    finally:
        app.close()


def seconds_left(page: Page) -> int:
    minutes, seconds = page.get_by_test_id("countdown").inner_text().split(":")
    return 60 * int(minutes) + int(seconds)


def end_break(server: Server) -> None:
    """The break is over by the server's clock, without waiting for it."""
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    with app.database.write() as db:
        db.query(SessionRow).one().break_ends_at = app.now()
    app.close()


@pytest.mark.parametrize("days", [-1, 365])
def test_a_wrong_date_changes_neither_the_break_nor_what_is_measured(
    page: Page, serve: Serve, days: int
) -> None:
    page.add_init_script(WRONG_DATE.replace("SHIFT_MS", str(days * DAY_MS)))
    server = serve(BREAK_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.wait_for_timeout(1000)
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_role("heading", level=1)).to_have_text("Take a break")
    expect(page.get_by_test_id("continue")).to_be_disabled()
    at_first = seconds_left(page)
    assert 0 < at_first <= BREAK_S
    page.wait_for_timeout(2000)
    assert seconds_left(page) <= at_first - 1
    end_break(server)
    page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
    expect(page.get_by_test_id("continue")).to_be_enabled()
    page.get_by_test_id("continue").click()
    watch(page)
    (measured,) = reaction_times_s(server)
    assert 1 < measured < 60


def test_a_browser_that_keeps_nothing_takes_part_like_any_other(page: Page, serve: Serve) -> None:
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.add_init_script(NO_STORAGE)
    server = serve(SMALL_PLAN + "familiarisation: {videos: 2, required: 0}\n")
    page.goto(f"{server.url}/s/small")
    for step in ("consent", "continue", "continue"):
        page.get_by_test_id(step).click()
    watch(page)
    server.kill()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_text("Not saved yet")).to_be_visible()
    server.start()
    expect(page.get_by_test_id("progress")).to_have_text("Part 1 of 1 · Pair 2 of 4")
    page.reload()
    watch(page)
    answer(page, "right", by="key")
    assert stored_responses(server) == ["left", "right"]
    assert faults == []


def sleep(context: BrowserContext, page: Page, seconds: float) -> None:
    """Nothing of the page runs meanwhile, as when the lid is shut."""
    browser = context.new_cdp_session(page)
    browser.send("Page.setWebLifecycleState", {"state": "frozen"})
    page.wait_for_timeout(seconds * 1000)
    browser.send("Page.setWebLifecycleState", {"state": "active"})


def test_after_sleep_the_pair_plays_on_and_is_answered_once(
    context: BrowserContext, page: Page, serve: Serve
) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    sleep(context, page, 3)
    watch(page)
    answer(page, "right", by="key")
    watch(page)
    assert stored_responses(server) == ["right"]


def test_a_break_goes_on_while_the_computer_sleeps(
    context: BrowserContext, page: Page, serve: Serve
) -> None:
    server = serve(BREAK_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_test_id("continue")).to_be_disabled()
    at_first = seconds_left(page)
    sleep(context, page, 3)
    page.wait_for_function(
        """(most) => {
            const clock = document.querySelector('[data-testid="countdown"]').textContent;
            const [minutes, seconds] = clock.split(":");
            return 60 * minutes + Number(seconds) <= most;
        }""",
        arg=at_first - 3,
        timeout=2000,
    )
