"""The videos of what may come next are fetched while a pair plays."""

from __future__ import annotations

import time
from collections.abc import Callable

from playwright.sync_api import Page, Request, Route

from .evaluator import answer, enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN

#: What follows the second pair depends on the answer to it.
PLAN = SMALL_PLAN.replace(
    "    method: pbpo\n", "    method: pbpo\n    settings: {random_queries: 2}\n"
)

Serve = Callable[[str], Server]


def test_word_of_an_earlier_pair_that_comes_late_stops_nothing(page: Page, serve: Serve) -> None:
    server = serve(PLAN)
    looks: list[Route] = []
    videos: list[Route] = []
    fetched: set[str] = set()

    def note(request: Request) -> None:
        if "/media/" in request.url:
            fetched.add(request.url.removeprefix(server.url))

    def hold_the_first(route: Route) -> None:
        looks.append(route)
        if len(looks) > 1:
            route.continue_()

    def hold(route: Route) -> None:
        videos.append(route)

    page.on("request", note)
    enter_small(page, f"{server.url}/s/small")
    page.route("**/api/v1/session", hold_the_first)
    while not looks:
        page.wait_for_timeout(100)
    answer(page, "left", by="key")
    watch(page)
    page.route("**/media/*.mp4", hold)
    coming: list[str] = []
    while not coming:
        with page.expect_response("**/api/v1/session") as said:
            pass
        coming = said.value.json()["query"]["prefetch"]
    assert len(coming) > 2

    # Two are on their way, and the others are waiting for them.
    while len(videos) < 2:
        page.wait_for_timeout(100)
    with page.expect_response("**/api/v1/session"):
        looks[0].continue_()
    page.wait_for_timeout(200)
    page.unroute("**/media/*.mp4")
    for route in videos:
        route.continue_()
    deadline = time.monotonic() + 5
    while not fetched >= set(coming) and time.monotonic() < deadline:
        page.wait_for_timeout(100)
    assert fetched >= set(coming)
