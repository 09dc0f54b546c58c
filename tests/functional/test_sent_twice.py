"""The consent form sent twice before the browser has its cookie: a double press without scripts."""

from __future__ import annotations

import hashlib
import re

import httpx
import pytest
from fastapi import FastAPI

from app.services.arrival import entry_links
from app.services.context import AppContext
from app.services.runtime.ids import receipt_code

from .client import Api
from .conftest import Recruit
from .test_at_once import at_once
from .test_participant_pages import COOKIE, HEADINGS, heading, sent_on, version
from .test_returning import sessions_and_people

#: Tells the forms of one browser from those of others.
BROWSER = "pbpo_keeps_cookies"
PLACES = "\nplaces: 1\n"
BLOCKING = """
recruitment: {platform: prolific, codes: {completed: COMPLETE1}, returning: block}
"""
PERSON = "?PROLIFIC_PID=5f0c"


def form(page: httpx.Response) -> dict[str, str]:
    found = re.search(r'name="arrival" value="([^"]+)"', page.text)
    assert found, page.text
    return {"version": version(page), "arrival": found[1]}


def without_session(client: Api) -> None:
    """As before the answer has come that brings the session's cookie."""
    if COOKIE in client.cookies:
        client.cookies.delete(COOKIE)


def test_two_forms_at_once_begin_one_session(
    application: FastAPI, client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("")
    given = form(client.get("/s/short"))
    browser = client.cookies[BROWSER]

    def press(api: Api) -> httpx.Response:
        api.cookies.set(BROWSER, browser)
        return api.post("/s/short/consent", data=given)

    answers = at_once(application, [press] * 4)
    for answer in answers:
        sent_on(answer)
    assert len({answer.cookies[COOKIE] for answer in answers}) == 1
    assert sessions_and_people(app) == (1, 1)


@pytest.mark.parametrize(("said", "link"), [(PLACES, ""), (BLOCKING, PERSON)])
def test_the_second_form_is_not_refused_what_the_first_one_took(
    client: Api, recruit: Recruit, app: AppContext, said: str, link: str
) -> None:
    recruit(said)
    given = form(client.get(f"/s/short{link}"))
    for _ in range(2):
        without_session(client)
        sent_on(client.post(f"/s/short/consent{link}", data=given))
    assert heading(client.get("/s/short")) == "What you will do"
    assert sessions_and_people(app) == (1, 1)


def test_the_second_form_of_a_link_for_one_person_is_that_persons(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("\nrecruitment: {links: single-use}\n")
    (link,) = entry_links.create(app, "short", 1)
    given = form(client.get(link))
    for _ in range(2):
        without_session(client)
        sent_on(client.post(link.replace("?", "/consent?", 1), data=given))
    assert sessions_and_people(app) == (1, 1)


def test_each_newcomers_form_has_a_value_of_its_own(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("")
    forms = [form(client.get("/s/short")) for _ in range(2)]
    for given in forms:
        without_session(client)
        sent_on(client.post("/s/short/consent", data=given))
    assert sessions_and_people(app) == (2, 2)


@pytest.mark.parametrize("arrival", ["", "1", "x" * 500])
def test_a_value_that_two_people_could_think_of_joins_nobody(
    client: Api, recruit: Recruit, app: AppContext, arrival: str
) -> None:
    recruit("")
    given = {**form(client.get("/s/short")), "arrival": arrival}
    for _ in range(2):
        without_session(client)
        sent_on(client.post("/s/short/consent", data=given))
    assert sessions_and_people(app) == (2, 2)


def test_a_session_that_is_there_is_asked_again_without_the_value(
    client: Api, recruit: Recruit
) -> None:
    recruit("")
    given = form(client.get("/s/short"))
    sent_on(client.post("/s/short/consent", data=given))
    assert heading(client.get("/s/short")) != HEADINGS["consent"]
    assert given["arrival"] not in client.get("/s/short").text


def test_a_value_that_somebody_chose_leads_each_browser_to_a_session_of_its_own(
    client: Api, application: FastAPI, recruit: Recruit, app: AppContext
) -> None:
    """Whoever had others send the form with a value that they know learns no token by it."""
    recruit("")
    chosen = "A" * 43
    tokens = set()
    for _ in range(3):
        with Api(application) as browser:
            given = {**form(browser.get("/s/short")), "arrival": chosen}
            sent_on(browser.post("/s/short/consent", data=given))
            tokens.add(browser.cookies[COOKIE])
    assert len(tokens) == 3
    assert sessions_and_people(app) == (3, 3)
    # What the value used to come to, and a form without the browser's own cookie.
    computed = hashlib.sha256(f"arrival:short:{chosen}".encode()).hexdigest()
    assert computed not in tokens
    with Api(application) as stranger:
        answer = stranger.post(
            "/s/short/consent", data={"version": given["version"], "arrival": chosen}
        )
        assert answer.cookies.get(COOKIE) not in tokens


def test_a_planted_sessions_token_is_worth_nothing_after_consent(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("")
    planted = client.start()
    client.cookies.set(COOKIE, planted.token)
    given = {"version": version(client.get("/s/short"))}
    tokens = set()
    for _ in range(2):
        # Pressed twice, before the first answer has come.
        client.cookies.set(COOKIE, planted.token)
        answer = client.post("/s/short/consent", data=given)
        sent_on(answer)
        tokens.add(answer.cookies[COOKIE])
    assert len(tokens) == 1
    assert planted.token not in tokens
    assert sessions_and_people(app) == (1, 1)
    assert client.get("/api/v1/session", headers=planted.headers).status_code == 401
    client.cookies.clear()
    client.cookies.set(COOKIE, tokens.pop())
    assert heading(client.get("/s/short")) == "What you will do"


def test_the_receipt_of_a_planted_session_deletes_nothing_after_consent(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("")
    planted = client.start()
    client.cookies.set(COOKIE, planted.token)
    sent_on(client.post("/s/short/consent", data={"version": version(client.get("/s/short"))}))
    receipt = {"receipt": receipt_code(planted.token)}
    refused = client.post("/api/v1/studies/short/deletions", json=receipt)
    assert refused.status_code == 404
    assert sessions_and_people(app) == (1, 1)
