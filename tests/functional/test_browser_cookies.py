"""A browser that keeps no cookies: it is told so, and nothing begins."""

from __future__ import annotations

from urllib.parse import urljoin

import httpx
import pytest

from app.services.arrival import entry_links
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo

from .client import Api
from .conftest import Recruit
from .test_entry_links import SINGLE_USE
from .test_leaving import rows_of_people
from .test_participant_pages import COOKIE, HEADINGS, heading, sent_on, version
from .test_recruitment import PROLIFIC

NO_COOKIES = "This browser keeps no cookies"


def press(client: Api, link: str = "/s/short", path: str = "consent") -> httpx.Response:
    """Agree in a browser that keeps no cookies, and follow where the form is sent on."""
    found = client.get(link)
    client.cookies.clear()
    form = {"version": version(found)} if path == "consent" else {}
    address = link.replace("/s/short", f"/s/short/{path}", 1)
    for _ in range(3):
        answer = client.post(address, data=form)
        client.cookies.clear()
        if answer.status_code != 307:
            break
        address = urljoin(address, answer.headers["location"])
    return answer


def test_without_cookies_no_session_begins_however_often_one_presses(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    for _ in range(3):
        page = press(client)
        assert (page.status_code, heading(page)) == (409, NO_COOKIES)
        assert COOKIE not in page.headers.get("set-cookie", "")
    assert rows_of_people(app) == {}


def test_a_personal_link_and_a_place_are_as_good_as_before(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(f"{SINGLE_USE}places: 1\n")
    link = entry_links.create(app, "short", 1)[0]
    page = press(client, link)
    assert heading(page) == NO_COOKIES
    assert f'href="{link}"' in page.text
    assert heading(client.get(link)) == HEADINGS["consent"]
    assert rows_of_people(app) == {"entry_links": 1}


def test_a_browser_that_brings_the_cookie_back_needs_one_press(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    given = {"version": version(client.get("/s/short"))}
    client.cookies.clear()
    # Its form stood open until the cookie was gone: it is sent on by itself, and begins a session.
    asked = client.post("/s/short/consent", data=given)
    assert asked.status_code == 307
    sent_on(client.post(asked.headers["location"], data=given))
    assert rows_of_people(app)["sessions"] == 1


def test_coming_back_needs_a_cookie_as_well(client: Api, recruit: Recruit, app: AppContext) -> None:
    recruit(PROLIFIC)
    client.start(external_ids={"PROLIFIC_PID": "one", "SESSION_ID": "s1"})
    page = press(client, "/s/short?PROLIFIC_PID=one&SESSION_ID=s1", "return")
    assert heading(page) == NO_COOKIES
    assert "reentries" not in rows_of_people(app)


@pytest.mark.parametrize(("scheme", "is_told"), [("http", True), ("https", False)])
def test_secure_cookies_over_plain_http_are_named_as_the_cause(
    client: Api, short_study: StudyInfo, app: AppContext, scheme: str, is_told: bool
) -> None:
    object.__setattr__(app.settings, "secure_cookies", True)
    page = press(client, f"{scheme}://testserver/s/short")
    assert heading(page) == NO_COOKIES
    assert ("Open it with https:// instead" in page.text) == is_told
