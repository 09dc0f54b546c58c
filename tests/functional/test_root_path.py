"""The studio below a path of a host: every address has the path, and none is missing."""

from __future__ import annotations

from html.parser import HTMLParser

import httpx
import pytest
from fastapi import FastAPI

from app.main import create_app
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings
from app.services.studies.repository import StudyInfo

from .client import Api
from .house import House
from .role_rules import RULES
from .test_experimenter_pages import form_token

ROOT = "/pbpo"
#: Attributes with an address.
_ADDRESSES = ("href", "src", "action", "formaction", "poster")
_OF_SCRIPTS = ("data-job", "data-live", "data-events", "data-figure", "data-answer", "data-trouble")


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """Below a path, and without a browser that takes pictures."""
    return settings.model_copy(update={"root_path": ROOT, "chromium": "no-such-browser"})


class _Addresses(HTMLParser):
    """Every address in a page, with its element and its method."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, str]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = dict(attrs)
        is_read = tag != "form" or said.get("method") == "get"
        for name in (*_ADDRESSES, *_OF_SCRIPTS):
            if said.get(name):
                self.found.append((str(said[name]), "GET" if is_read else "POST"))


def _own(answer: httpx.Response) -> set[tuple[str, str]]:
    """The addresses of a page that are the studio's own, with their methods."""
    found = _Addresses(answer.text).found
    elsewhere = ("#", "?", "mailto:", "https:", "data:")
    host = "http://testserver"
    return {
        (address.removeprefix(host), method)
        for address, method in found
        if not address.startswith(elsewhere)
    }


def test_every_address_on_every_page_has_the_path_and_leads_somewhere(house: House) -> None:
    pages, links = 0, set()
    for route, rule in RULES.items():
        if not route.startswith("GET /"):
            continue
        for caller in ("admin", "owner", *house.evaluators):
            answer = house.ask(caller, route, rule)
            if "location" in answer.headers:
                assert answer.headers["location"].startswith((f"{ROOT}/", "https:")), route
            if not answer.headers.get("content-type", "").startswith("text/html"):
                continue
            pages += 1
            own = _own(answer)
            bare = [address for address, _ in own if not address.startswith(f"{ROOT}/")]
            assert bare == [], route
            links |= {(caller, address) for address, method in own if method == "GET"}
    assert pages > 100
    assert len(links) > 100
    for caller, address in sorted(links):
        if "/figures/" in address or "/live" in address or "/events" in address:
            continue
        assert house.send(caller, "GET", address).status_code not in (404, 500), address


def test_a_proxy_may_strip_the_path_or_leave_it(client: Api, short_study: StudyInfo) -> None:
    for path in ("/s/short", f"{ROOT}/s/short"):
        answer = client.get(path)
        assert answer.status_code == 200
        assert f'action="{ROOT}/s/short/consent' in answer.text
        assert f'src="{ROOT}/static/js/page.js"' in answer.text
        assert f'data-root="{ROOT}"' in answer.text
    assert client.get(ROOT).headers["location"] == f"{ROOT}/studies"
    assert client.get("/").headers["location"] == f"{ROOT}/studies"
    # With a slash too many the way leads back below the path.
    assert client.get(f"{ROOT}/studies/").headers["location"].startswith(f"{ROOT}/studies")
    # What is only like the path is another address.
    assert client.get("/pbpox/s/short").status_code == 404


def test_signing_in_leads_back_to_where_one_wanted_to(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    answer = client.get(f"{ROOT}/studies/short")
    assert answer.headers["location"] == f"{ROOT}/sign-in?next=/studies/short"
    page = client.get(answer.headers["location"])
    given = {"email": "ada@lab.example", "password": "correct horse battery"}
    answer = client.post(
        f"{ROOT}/sign-in",
        data={**given, "csrf_token": form_token(page), "next": "/studies/short"},
    )
    assert answer.headers["location"] == f"{ROOT}/studies/short"
    assert client.get(answer.headers["location"]).status_code == 200


def test_cookies_are_for_the_path_alone(client: Api, short_study: StudyInfo) -> None:
    answers = [client.get(f"{ROOT}/s/short"), client.get(f"{ROOT}/sign-in")]
    cookies = [cookie for answer in answers for cookie in answer.headers.get_list("set-cookie")]
    assert len(cookies) >= 2
    for cookie in cookies:
        assert f"; Path={ROOT};" in f"{cookie};", cookie


def test_secure_cookies_are_not_named_as_those_of_a_whole_host(
    application: FastAPI, app: AppContext, short_study: StudyInfo
) -> None:
    object.__setattr__(app, "settings", app.settings.model_copy(update={"secure_cookies": True}))
    with Api(application, base_url="https://testserver") as https:
        (cookie,) = https.get(f"{ROOT}/sign-in").headers.get_list("set-cookie")
        assert cookie.startswith("__Secure-pbpo_form=")
        assert "; secure" in cookie.lower()
        session = https.start().to_first_query()
        # One of the host's root comes last, as browsers send it, and is not taken for ours.
        both = f"__Secure-pbpo_session_short={session.token}; __Secure-pbpo_session_short=other"
        told = https.get(f"{ROOT}/api/v1/session", headers={"PBPO-Study": "short", "Cookie": both})
        assert told.json()["stage"] == "query"


def test_videos_and_public_links_have_the_path(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    query = session.state["query"]
    for address in (query["left"]["url"], query["right"]["url"], *query["prefetch"]):
        assert address.startswith(f"{ROOT}/media/")
    update = {"public_url": "https://lab.example"}
    object.__setattr__(app, "settings", app.settings.model_copy(update=update))
    client.cookies.set("pbpo_session_short", session.token)
    page = client.get(f"{ROOT}/s/short/withdraw")
    assert page.status_code == 200
    assert app.settings.public_base == "https://lab.example/pbpo"


def test_the_api_says_where_it_is(app: AppContext) -> None:
    with Api(create_app(app=app)) as client:
        assert client.get(f"{ROOT}/openapi.json").json()["servers"] == [{"url": ROOT}]


def test_a_path_that_begins_as_the_studios_own_addresses_is_refused(app: AppContext) -> None:
    settings = app.settings.model_copy(update={"root_path": "/studies"})
    object.__setattr__(app, "settings", settings)
    with pytest.raises(ConflictError, match="begins otherwise than the studio's own"):
        create_app(app=app)
