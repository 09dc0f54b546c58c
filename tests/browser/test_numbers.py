"""A number that could be two is asked back on the page, and stored as its writer meant it."""

from __future__ import annotations

import os
from collections.abc import Callable

import httpx
import pytest
from playwright.sync_api import Browser, expect

from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN

PLAN = (
    SMALL_PLAN.replace("languages: [en]", "languages: [en, ja]")
    .replace("title: Small", "title: {en: Small, ja: 小さな調査}")
    .replace("{label: I don't like either.}", "{label: {en: Neither, ja: どちらも良くない}}")
    .replace("queries_per_trial: 4", "queries_per_trial: 1")
    + """
questionnaires:
  after_trial:
    - {name: income, type: number, label: {en: "What do you earn?", ja: 収入}}
    - {name: age, type: number, min: 18, label: {en: "How old are you?", ja: 年齢}}
"""
)


def to_the_questions(client: httpx.Client, language: str) -> str:
    """The token of a session that stands at the questions; the client holds it."""
    begun = client.post("/studies/small/sessions", json={"language": language}).json()
    client.headers["Authorization"] = f"Bearer {begun['token']}"
    state = begun["session"]
    while state["stage"] != "questionnaire":
        if state["stage"] == "consent":
            body = {"version": state["consent"]["version"]}
            state = client.post("/session/consent", json=body).json()
        elif state["stage"] == "query":
            body = {"query_id": state["query"]["id"], "response": "left", "rt_ms": 900}
            state = client.post("/session/responses", json=body).json()
        else:
            state = client.post("/session/continue").json()
    return str(begun["token"])


@pytest.mark.parametrize(
    ("width", "locale", "question"),
    [(360, "ja-JP", "どの数"), (1440, "en-US", "Which number do you mean?")],
)
def test_a_number_that_could_be_two_is_chosen_on_the_page(
    browser: Browser, serve: Callable[[str], Server], width: int, locale: str, question: str
) -> None:
    server = serve(PLAN)
    with httpx.Client(base_url=f"{server.url}/api/v1", timeout=60) as client:
        token = to_the_questions(client, locale[:2])
    context = browser.new_context(viewport={"width": width, "height": 800}, locale=locale)
    context.add_cookies([{"name": "pbpo_session_small", "value": token, "url": server.url}])
    page = context.new_page()
    page.goto(f"{server.url}/s/small")
    page.locator("input[name=income]").fill("50,000")
    page.locator("input[name=age]").fill("30")
    page.get_by_test_id("continue").click()

    expect(page.locator("#fault-income")).to_contain_text(question)
    expect(page.locator("input[name=income]")).to_have_value("50,000")
    expect(page.locator("input[name=age]")).to_have_value("30")
    offered = page.get_by_test_id("meant")
    expect(offered).to_have_count(2)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert violations(page, "light") == []
    if folder := os.environ.get("PBPO_TEST_PICTURES"):
        page.screenshot(path=f"{folder}/number-{width}.png", full_page=True)
    page.get_by_label("50000", exact=True).check()
    page.get_by_test_id("continue").click()
    # Taken: what comes next is no question about income.
    expect(page.locator("input[name=income]")).to_have_count(0)
    context.close()
