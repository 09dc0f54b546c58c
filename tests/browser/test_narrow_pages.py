"""Every page of a session fits a page of 320 px without sideways scrolling (WCAG 1.4.10)."""

from __future__ import annotations

from collections.abc import Callable

import httpx
from playwright.sync_api import Browser, Page

from .server import Server
from .small_study import SMALL_PLAN

PLAN = (
    SMALL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1\ntrials_per_condition: 2")
    .replace("break_s: 0", "break_s: 1")
    .replace("title: Small", "title: Which of two robots pours water more carefully into a glass?")
    + """
contact: somebody.with.a.long.name@laboratory.university.example
device_check: {test_clip: false, min_width_px: 300}
familiarisation: {videos: 2, required: 0}
practice: {queries: 1}
questionnaires:
  after_trial:
    - {name: mood, type: likert, points: 11, label: "How are you?", labels: [Bad, Good]}
    - {name: word, type: text, label: "A word?", required: false}
"""
)

WIDTH = 320

#: Pages beside the stages, which have no other way in here.
ASIDE = (
    *("privacy", "withdraw", "not-you", "delete"),
    *("trouble/videos", "trouble/browser", "trouble/screen"),
)


def expect_no_sideways_scrolling(page: Page, name: str) -> None:
    assert page.evaluate("document.documentElement.scrollWidth") <= WIDTH, name


def test_no_page_scrolls_sideways(browser: Browser, serve: Callable[[str], Server]) -> None:
    server = serve(PLAN)
    url = f"{server.url}/s/small"
    context = browser.new_context(viewport={"width": WIDTH, "height": 640}, has_touch=True)
    page = context.new_page()
    page.goto(url)
    expect_no_sideways_scrolling(page, "first page")
    with httpx.Client(base_url=f"{server.url}/api/v1", timeout=60) as client:
        begun = client.post("/studies/small/sessions", json={}).json()
        client.headers["Authorization"] = f"Bearer {begun['token']}"
        cookie = {"name": "pbpo_session_small", "value": begun["token"], "url": server.url}
        context.add_cookies([cookie])  # type: ignore[list-item]
        state, seen = begun["session"], set()
        # A break is asked again until it is over.
        for _ in range(40):
            stage = state["stage"]
            page.goto(url)
            expect_no_sideways_scrolling(page, stage)
            if stage == "query" and stage not in seen:
                for aside in ASIDE:
                    page.goto(f"{url}/{aside}")
                    expect_no_sideways_scrolling(page, aside)
            seen.add(stage)
            if stage == "completed":
                break
            state = _on(client, state)
    context.close()
    wanted = {"device_check", "instructions", "familiarisation", "practice", "query", "break"}
    assert seen >= wanted | {"questionnaire", "debrief"}


def _on(client: httpx.Client, state: dict[str, object]) -> dict[str, object]:
    """The state after the session has been taken one step further."""
    match state["stage"]:
        case "consent":
            consent = state["consent"]
            assert isinstance(consent, dict)
            answer = client.post("/session/consent", json={"version": consent["version"]})
        case "query" | "practice":
            query = state["query"]
            assert isinstance(query, dict)
            body = {"query_id": query["id"], "response": "left", "rt_ms": 900}
            answer = client.post("/session/responses", json=body)
        case "questionnaire":
            answer = client.post("/session/questionnaire", json={"answers": {"mood": 3}})
        case "device_check":
            measured = {"width_px": WIDTH, "played": True, "mbit_s": None}
            answer = client.post("/session/continue", json={"device": measured})
        case _:
            answer = client.post("/session/continue")
    found: dict[str, object] = answer.json() if answer.is_success else state
    return found
