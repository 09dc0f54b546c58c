"""The videos of what may come next are fetched while a pair plays."""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import urlsplit

from playwright.sync_api import Page, Request, Response, Route

from .evaluator import enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN

#: What follows the second pair depends on the answer to it.
PLAN = SMALL_PLAN.replace(
    "    method: pbpo\n", "    method: pbpo\n    settings: {random_queries: 2}\n"
)

#: So many that hardly any two answers lead to the same pair.
CANDIDATES = 30

SOON_S = 30.0


def until(page: Page, condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline, what
        page.wait_for_timeout(50)


def path(request: Request) -> str:
    return urlsplit(request.url).path


def test_word_of_an_earlier_pair_that_comes_late_stops_nothing(
    page: Page, serve: Callable[..., Server]
) -> None:
    server = serve(PLAN, candidates=CANDIDATES)
    looks: list[Route] = []
    videos: list[Route] = []
    said: list[Response] = []
    fetched: set[str] = set()
    of_this_pair: set[str] = set()

    def hold_the_first(route: Route) -> None:
        looks.append(route)
        if len(looks) > 1:
            route.continue_()

    def hold(route: Route) -> None:
        if path(route.request) in of_this_pair:
            route.continue_()
        else:
            videos.append(route)

    def hear(response: Response) -> None:
        said.append(response)

    page.on("request", lambda request: fetched.add(path(request)))
    page.route("**/api/v1/session", hold_the_first)
    enter_small(page, f"{server.url}/s/small")
    until(page, lambda: looks, "the page looks ahead")
    page.route("**/media/*.mp4", hold)
    page.on("response", hear)
    with page.expect_response("**/api/v1/session/responses") as answered:
        page.keyboard.press("ArrowLeft")
    query = answered.value.json()["query"]
    of_this_pair.update(query[side]["url"] for side in ("left", "right"))
    for route in [one for one in videos if path(one.request) in of_this_pair]:
        videos.remove(route)
        route.continue_()
    watch(page)

    coming: list[str] = query["prefetch"]
    while not coming:
        until(page, lambda: said, "the page hears what may come next")
        if path(said[0].request) == "/api/v1/session":
            coming = said[0].json()["query"]["prefetch"]
        said.pop(0)
    assert len(coming) > 2

    # Two are on their way, and the others are waiting for them.
    until(page, lambda: len(videos) == 2, "two videos are on their way")
    with page.expect_response("**/api/v1/session"):
        looks[0].continue_()
    page.wait_for_timeout(200)
    page.unroute("**/media/*.mp4")
    for route in videos:
        route.continue_()
    until(page, lambda: fetched >= set(coming), "all were fetched")
