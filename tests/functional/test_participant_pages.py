"""The evaluator's pages over HTTP: the server alone decides which one is shown."""

from __future__ import annotations

import re
from typing import Any

import httpx
import pytest

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import FROM_PROLIFIC, Clock

from .client import Api, Session
from .conftest import EMAIL, PASSWORD, Recruit

COOKIE = "pbpo_session_short"


def heading(response: httpx.Response) -> str:
    """The page's own title: which page it is."""
    found = re.search(r"<h1[^>]*>(.*?)</h1>", response.text, re.DOTALL)
    assert found, response.text
    return found[1].strip()


def version(page: httpx.Response) -> str:
    found = re.search(r'name="version" value="([0-9a-f]+)"', page.text)
    assert found, page.text
    return found[1]


def sent_on(response: httpx.Response) -> None:
    assert (response.status_code, response.headers["location"]) == (303, "/s/short")


def come_back(client: Api, query: str, **data: str) -> httpx.Response:
    """Press what leads a person back into their session."""
    client.get(f"/s/short{query}")
    return client.post(f"/s/short/return{query}", data=data)


def agree(client: Api, query: str = "") -> httpx.Response:
    page = client.get(f"/s/short{query}")
    return client.post(f"/s/short/consent{query}", data={"version": version(page)})


def in_browser(client: Api, stage: str, clock: Clock) -> Session:
    """A session at this stage whose token the browser has as a cookie."""
    session = client.start().to_stage(stage, clock.forward)
    client.cookies.set(COOKIE, session.token)
    return session


def token_for(app: AppContext) -> str:
    return accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")


def kept(client: Api, api_token: str) -> int:
    """How many people anything is kept of."""
    return len(client.table("participants", api_token, "all"))


HEADINGS = {
    "consent": "Before you take part",
    "query": "Which video is better?",
    "break": "Take a break",
    "completed": "Thank you",
    "declined": "That is fine",
}


def test_a_newcomer_sees_the_consent_and_nothing_is_kept(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    page = client.get("/s/short?PROLIFIC_PID=abc")
    assert page.status_code == 200
    assert heading(page) == HEADINGS["consent"]
    assert "You choose between videos." in page.text
    # A random value that is stored nowhere else, and goes when the browser is closed.
    assert re.fullmatch(
        r"pbpo_keeps_cookies=[\w-]{43}; HttpOnly; Path=/; SameSite=lax", page.headers["set-cookie"]
    )
    assert page.headers["cache-control"] == "no-store"
    assert kept(client, api_token) == 0


def test_consent_begins_one_session_and_gives_its_browser_a_cookie(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    answer = agree(client)
    sent_on(answer)
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{COOKIE}=")
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    sessions = client.table("sessions", api_token)
    assert sessions["stage"].to_list() == ["instructions"]
    assert "Choose the video in which waste falls evenly." in client.get("/s/short").text


def test_consent_sent_twice_is_one_session(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    given = {"version": version(client.get("/s/short"))}
    for _ in range(3):
        sent_on(client.post("/s/short/consent", data=given))
    assert client.table("sessions", api_token)["stage"].to_list() == ["instructions"]


def test_consent_to_another_text_shows_the_text_in_force_and_keeps_nothing(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    sent_on(client.post("/s/short/consent", data={"version": "0" * 12}))
    assert heading(client.get("/s/short")) == HEADINGS["consent"]
    assert kept(client, api_token) == 0

    session = in_browser(client, "consent", Clock())
    sent_on(client.post("/s/short/consent", data={"version": "0" * 12}))
    assert session.look()["stage"] == "consent"


def test_declining_leaves_no_trace(client: Api, short_study: StudyInfo, api_token: str) -> None:
    page = client.post("/s/short/decline?PROLIFIC_PID=abc")
    assert (page.status_code, heading(page)) == (200, HEADINGS["declined"])
    assert kept(client, api_token) == 0
    assert "set-cookie" not in page.headers


def test_declining_a_session_that_began_leaves_no_platform_id(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(FROM_PROLIFIC)
    session = client.start(external_ids={"PROLIFIC_PID": "abc"})
    client.cookies.set(COOKIE, session.token)
    sent_on(client.post("/s/short/decline"))
    assert heading(client.get("/s/short")) == HEADINGS["declined"]
    assert client.table("identities", token_for(app)).empty


def test_a_platforms_ids_travel_from_the_link_to_the_identities(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(FROM_PROLIFIC)
    link = "?PROLIFIC_PID=5f0c&STUDY_ID=77&SESSION_ID=s%26x&empty="
    page = client.get(f"/s/short{link}")
    assert 'action="/s/short/consent?PROLIFIC_PID=5f0c&amp;STUDY_ID=77' in page.text
    agree(client, link)
    identities = client.table("identities", token_for(app))
    rows = identities[["key", "value"]].to_numpy().tolist()
    assert {key: str(value) for key, value in rows} == {
        "PROLIFIC_PID": "5f0c",
        "STUDY_ID": "77",
        "SESSION_ID": "s&x",
    }


def test_a_link_with_much_besides_lets_one_in_and_an_id_that_is_too_long_does_not(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(FROM_PROLIFIC)
    link = "?" + "&".join(f"key{'k' * 80}{n}={'v' * 300}" for n in range(15))
    for query in (f"{link}&PROLIFIC_PID={'v' * 201}", "?PROLIFIC_PID=a&prolific_pid=b"):
        page = client.get(f"/s/short{query}")
        assert (page.status_code, heading(page)) == (422, "Not understood")
        assert "does not say clearly who you are" in page.text
        assert client.post(f"/s/short/consent{query}", data={"version": "0"}).status_code == 422
    sent_on(agree(client, f"{link}&PROLIFIC_PID={'v' * 200}"))
    identities = client.table("identities", token_for(app))
    assert identities[["key", "value"]].to_numpy().tolist() == [["PROLIFIC_PID", "v" * 200]]


def test_what_a_link_says_is_never_run(client: Api, short_study: StudyInfo) -> None:
    page = client.get('/s/short?x="><script>alert(1)</script>')
    assert "<script>alert" not in page.text


def test_a_whole_session_by_forms_and_responses(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    agree(client)
    seen: list[str] = []
    headers = {"PBPO-Study": "short"}
    while (state := client.get("/api/v1/session", headers=headers).json())["stage"] != "completed":
        page = client.get("/s/short")
        assert page.status_code == 200, page.text
        if not seen or seen[-1] != state["stage"]:
            seen.append(state["stage"])
        if state["stage"] == "query":
            body = {"query_id": state["query"]["id"], "response": "right", "rt_ms": 1}
            client.post("/api/v1/session/responses", json=body, headers=headers)
            continue
        clock.forward(state.get("break", {}).get("seconds_left", 0))
        sent_on(client.post("/s/short/continue"))
    trials = ["query", "break", "query", "break", "query"]
    assert seen == ["instructions", "familiarisation", *trials, "debrief"]
    assert heading(client.get("/s/short")) == HEADINGS["completed"]


def test_a_page_leaves_nothing_but_its_own_stage(client: Api, short_study: StudyInfo) -> None:
    agree(client)
    left = {"leaving": "instructions"}
    assert 'name="leaving" value="instructions"' in client.get("/s/short").text
    for _ in range(2):
        sent_on(client.post("/s/short/continue", data=left))
        page = client.get("/s/short")
        assert 'name="leaving" value="familiarisation"' in page.text
    sent_on(client.post("/s/short/continue", data={"leaving": "familiarisation"}))
    assert heading(client.get("/s/short")) == HEADINGS["query"]


@pytest.mark.parametrize("stage", ["query", "break", "completed", "declined"])
def test_going_back_and_sending_a_form_again_shows_where_one_is(
    client: Api, short_study: StudyInfo, clock: Clock, stage: str
) -> None:
    session = in_browser(client, stage, clock)
    before = session.look()["progress"]
    sent_on(client.post("/s/short/consent", data={"version": "0" * 12}))
    sent_on(client.post("/s/short/continue"))
    assert heading(client.get("/s/short")) == HEADINGS[stage]
    after = session.look()
    assert (after["stage"], after["progress"]) == (stage, before)


def test_a_break_has_a_button_that_cannot_be_pressed_until_it_is_over(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    in_browser(client, "break", clock)
    button = re.compile(r'data-testid="continue"[^>]* disabled')
    assert button.search(client.get("/s/short").text)
    clock.forward(120)
    page = client.get("/s/short")
    assert heading(page) == HEADINGS["break"]
    assert not button.search(page.text)


def test_a_query_without_a_skip_has_no_skip_button(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = in_browser(client, "query", clock)
    buttons = []
    while session.state["stage"] != "debrief":
        if session.state["progress"]["query"] == 1 and session.state["stage"] == "query":
            offered = session.state["query"]["skip"] is not None
            buttons.append(('data-testid="skip"' in client.get("/s/short").text, offered))
        session.step("left", clock.forward)
    assert sorted(buttons) == [(False, False), (True, True), (True, True)]


def test_stopping_is_asked_about_first_and_then_final(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = in_browser(client, "query", clock)
    page = client.get("/s/short/withdraw")
    assert heading(page) == "Stop taking part?"
    assert 'data-testid="withdraw-confirm"' in page.text
    assert session.look()["stage"] == "query"
    for _ in range(2):
        sent_on(client.post("/s/short/withdraw"))
    assert session.look()["stage"] == "withdrawn"
    sent_on(client.get("/s/short/withdraw"))


@pytest.mark.parametrize("path", ["continue", "withdraw"])
def test_a_browser_without_a_session_is_led_to_the_consent(
    client: Api, short_study: StudyInfo, path: str
) -> None:
    sent_on(client.post(f"/s/short/{path}"))
    client.cookies.set(COOKIE, "made-up")
    sent_on(client.post(f"/s/short/{path}"))
    sent_on(client.get("/s/short/withdraw"))
    assert heading(client.get("/s/short")) == HEADINGS["consent"]


def test_an_expired_session_says_so_and_then_lets_one_begin_again(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    in_browser(client, "query", clock)
    clock.forward(14 * 24 * 3600)
    expired = client.get("/s/short")
    assert heading(expired) == "This session has ended"
    assert f'{COOKIE}=""' in expired.headers["set-cookie"]


def test_a_study_that_is_not_open_says_so(
    client: Api, app: AppContext, short_study: StudyInfo, api_token: str
) -> None:
    given = {"version": version(client.get("/s/short"))}
    repository.close_study(app, "short")
    page = client.get("/s/short")
    assert (page.status_code, heading(page)) == (409, "This study is not open")
    assert client.post("/s/short/consent", data=given).status_code == 409
    assert kept(client, api_token) == 0


def test_a_closed_study_lets_those_inside_finish(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock
) -> None:
    in_browser(client, "query", clock)
    repository.close_study(app, "short")
    assert heading(client.get("/s/short")) == HEADINGS["query"]


@pytest.mark.parametrize("path", ["/s/nowhere", "/s/nowhere/else", "/nothing"])
def test_a_page_that_is_not_there_is_a_page_that_says_so(client: Api, path: str) -> None:
    page = client.get(path)
    assert page.status_code == 404
    assert page.headers["content-type"].startswith("text/html")
    assert heading(page) == "Not found"


def test_a_form_with_a_field_missing_is_not_understood(client: Api, short_study: StudyInfo) -> None:
    page = client.post("/s/short/consent", data={})
    assert (page.status_code, heading(page)) == (422, "Not understood")


def test_two_studies_can_go_on_in_one_browser(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = in_browser(client, "query", clock)
    client.cookies.set("pbpo_session_other", "token of another study")
    assert heading(client.get("/s/short")) == HEADINGS["query"]
    state: dict[str, Any] = client.get("/api/v1/session", headers={"PBPO-Study": "short"}).json()
    assert state["query"]["id"] == session.state["query"]["id"]
