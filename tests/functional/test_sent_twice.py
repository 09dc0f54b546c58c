"""The consent form sent twice before the browser has its cookie: a double press without scripts."""

from __future__ import annotations

import re

import httpx
import pytest
from fastapi import FastAPI

from app.services import entry_links
from app.services.studio import Studio

from .client import Api
from .conftest import Recruit
from .test_at_once import at_once
from .test_participant_pages import COOKIE, HEADINGS, heading, sent_on, version
from .test_returning import sessions_and_people

PLACES = "\nplaces: 1\n"
BLOCKING = """
recruitment: {platform: prolific, codes: {completed: COMPLETE1}, returning: block}
"""
PERSON = "?PROLIFIC_PID=5f0c"


def without_its_session(client: Api) -> None:
    """The browser as it is until the first answer has brought it the session's cookie."""
    client.cookies.clear()
    client.cookies.set("pbpo_keeps_cookies", "1")


def form(page: httpx.Response) -> dict[str, str]:
    found = re.search(r'name="arrival" value="([^"]+)"', page.text)
    assert found, page.text
    return {"version": version(page), "arrival": found[1]}


def test_two_forms_at_once_begin_one_session(
    application: FastAPI, client: Api, recruit: Recruit, studio: Studio
) -> None:
    recruit("")
    given = form(client.get("/s/short"))
    headers = {"Cookie": "pbpo_keeps_cookies=1"}
    answers = at_once(
        application,
        [lambda api: api.post("/s/short/consent", data=given, headers=headers)] * 4,
    )
    for answer in answers:
        sent_on(answer)
    assert len({answer.cookies[COOKIE] for answer in answers}) == 1
    assert sessions_and_people(studio) == (1, 1)


@pytest.mark.parametrize(("said", "link"), [(PLACES, ""), (BLOCKING, PERSON)])
def test_the_second_form_is_not_refused_what_the_first_one_took(
    client: Api, recruit: Recruit, studio: Studio, said: str, link: str
) -> None:
    recruit(said)
    given = form(client.get(f"/s/short{link}"))
    for _ in range(2):
        without_its_session(client)
        sent_on(client.post(f"/s/short/consent{link}", data=given))
    assert heading(client.get("/s/short")) == "What you will do"
    assert sessions_and_people(studio) == (1, 1)


def test_the_second_form_of_a_link_for_one_person_is_that_persons(
    client: Api, recruit: Recruit, studio: Studio
) -> None:
    recruit("\nrecruitment: {links: single-use}\n")
    (link,) = entry_links.create(studio, "short", 1)
    given = form(client.get(link))
    for _ in range(2):
        without_its_session(client)
        sent_on(client.post(link.replace("?", "/consent?", 1), data=given))
    assert sessions_and_people(studio) == (1, 1)


def test_each_newcomers_form_has_a_value_of_its_own(
    client: Api, recruit: Recruit, studio: Studio
) -> None:
    recruit("")
    forms = [form(client.get("/s/short")) for _ in range(2)]
    for given in forms:
        without_its_session(client)
        sent_on(client.post("/s/short/consent", data=given))
    assert sessions_and_people(studio) == (2, 2)


@pytest.mark.parametrize("arrival", ["", "1", "x" * 500])
def test_a_value_that_two_people_could_think_of_joins_nobody(
    client: Api, recruit: Recruit, studio: Studio, arrival: str
) -> None:
    recruit("")
    given = {**form(client.get("/s/short")), "arrival": arrival}
    for _ in range(2):
        without_its_session(client)
        sent_on(client.post("/s/short/consent", data=given))
    assert sessions_and_people(studio) == (2, 2)


def test_a_session_that_is_there_is_asked_again_without_the_value(
    client: Api, recruit: Recruit
) -> None:
    recruit("")
    given = form(client.get("/s/short"))
    sent_on(client.post("/s/short/consent", data=given))
    assert heading(client.get("/s/short")) != HEADINGS["consent"]
    assert given["arrival"] not in client.get("/s/short").text
