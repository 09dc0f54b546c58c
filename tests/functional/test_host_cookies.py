"""Where cookies are secure, no other host of the same site can plant one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from fastapi import FastAPI

from app.services.context import AppContext
from app.services.studies.repository import StudyInfo

from .client import Api
from .test_experimenter_pages import sign_in
from .test_participant_pages import HEADINGS, heading, version

SESSION = "__Host-pbpo_session_short"


@pytest.fixture
def https(application: FastAPI, app: AppContext, short_study: StudyInfo) -> Iterator[Api]:
    """A browser that comes by HTTPS to a studio whose cookies are secure."""
    secure = app.settings.model_copy(update={"secure_cookies": True})
    object.__setattr__(app, "settings", secure)
    with Api(application, base_url="https://testserver") as api:
        yield api


def test_every_cookie_is_of_this_host_alone(https: Api, api_token: str) -> None:
    page = https.get("/s/short")
    agreed = https.post("/s/short/consent", data={"version": version(page)})
    deleted = https.post("/s/short/withdraw", data={"delete": "1"})
    signed_in = sign_in(https)
    answers = [page, agreed, deleted, https.get("/sign-in"), signed_in]
    cookies = [cookie for answer in answers for cookie in answer.headers.get_list("set-cookie")]
    assert {SESSION, "__Host-pbpo_sign_in"} <= {cookie.partition("=")[0] for cookie in cookies}
    for cookie in cookies:
        assert cookie.startswith("__Host-pbpo_"), cookie
        # Without these a browser takes no cookie of such a name, nor deletes one.
        assert "; secure" in cookie.lower(), cookie
        assert "; path=/;" in f"{cookie};".lower(), cookie
        assert "domain" not in cookie.lower(), cookie
    assert https.get("/studies").status_code == 200


def test_a_session_goes_on_by_its_cookie(https: Api) -> None:
    session = https.start().to_first_query()
    https.cookies.set(SESSION, session.token)
    told = https.get("/api/v1/session", headers={"PBPO-Study": "short"})
    assert told.json()["stage"] == "query"


def test_a_cookie_that_another_host_could_have_planted_is_not_read(https: Api) -> None:
    session = https.start().to_first_query()
    https.cookies.set("pbpo_session_short", session.token)
    assert heading(https.get("/s/short")) == HEADINGS["consent"]


def test_over_plain_http_cookies_keep_their_names(client: Api, short_study: StudyInfo) -> None:
    page = client.get("/s/short")
    client.post("/s/short/consent", data={"version": version(page)})
    assert "pbpo_session_short" in client.cookies
