"""What every response tells a browser, and which requests of other sites are refused."""

from __future__ import annotations

import pytest
from fastapi import FastAPI

from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies.repository import StudyInfo

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_experimenter_pages import form_token

EXPECTED = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/s/short",
        "/s/nowhere",
        "/nothing",
        "/sign-in",
        "/studies",
        "/openapi.json",
        "/static/css/app.css",
        "/api/v1/session",
        "/media/nothing.mp4",
    ],
)
def test_every_response_forbids_what_our_pages_do_not_need(
    client: Api, short_study: StudyInfo, path: str
) -> None:
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert {name: headers[name] for name in EXPECTED} == EXPECTED
    assert "strict-transport-security" not in headers


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_form_of_another_site_is_refused_before_it_is_read(
    client: Api, short_study: StudyInfo, api_token: str, site: str
) -> None:
    """Nor is one of another host of the same site, such as a university's."""
    elsewhere = {"Sec-Fetch-Site": site}
    for path in (
        *("/s/short/consent", "/s/short/withdraw", "/sign-in"),
        *("/api/v1/studies/short/sessions", "/api/v1/session/withdraw"),
    ):
        refusal = client.post(path, headers=elsewhere)
        assert refusal.status_code == 403
        assert "default-src 'none'" in refusal.headers["content-security-policy"]
    assert client.table("sessions", api_token).empty


@pytest.mark.parametrize("site", ["same-origin", "none"])
def test_a_form_of_our_own_pages_is_taken(client: Api, short_study: StudyInfo, site: str) -> None:
    path = "/api/v1/studies/short/sessions"
    assert client.post(path, json={}, headers={"Sec-Fetch-Site": site}).status_code == 201


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_link_on_another_site_leads_in(client: Api, short_study: StudyInfo, site: str) -> None:
    page = client.get("/s/short", headers={"Sec-Fetch-Site": site})
    assert page.status_code == 200


def test_pages_hold_no_script_and_no_style_of_their_own(
    client: Api, short_study: StudyInfo
) -> None:
    client.cookies.set("pbpo_session_short", client.start().to_first_query().token)
    for path in ("/s/short", "/s/short/withdraw", "/sign-in"):
        page = client.get(path).text
        assert "<style" not in page
        assert " style=" not in page
        assert " onclick=" not in page
        for tag in page.split("<script")[1:]:
            assert 'src="/static/' in tag[:80] or 'type="application/json"' in tag[:80]


def test_static_files_are_asked_about_again_unless_named_by_their_content(client: Api) -> None:
    plain = client.get("/static/css/app.css")
    assert plain.headers["cache-control"] == "no-cache"
    again = client.get("/static/css/app.css", headers={"If-None-Match": plain.headers["etag"]})
    assert again.status_code == 304
    named = client.get("/static/css/app.css?v=0123")
    assert "immutable" in named.headers["cache-control"]


@pytest.mark.parametrize("path", ["/static/../app/main.py", "/static/%2e%2e/app/main.py"])
def test_nothing_beside_the_static_files_is_given_away(client: Api, path: str) -> None:
    assert client.get(path).status_code == 404


class TestBehindTls:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"secure_cookies": True})

    def test_cookies_are_sent_over_https_only(
        self, application: FastAPI, app: AppContext, short_study: StudyInfo, api_token: str
    ) -> None:
        with Api(application, base_url="https://testserver") as client:
            page = client.get("/sign-in")
            given = {"email": EMAIL, "password": PASSWORD, "csrf_token": form_token(page)}
            for response in (page, client.post("/sign-in", data=given)):
                assert "Secure" in response.headers["set-cookie"]

    def test_browsers_are_told_to_come_by_https_alone(
        self, application: FastAPI, app: AppContext
    ) -> None:
        with Api(application, base_url="https://testserver") as client:
            for path in ("/", "/nothing", "/static/css/app.css", "/api/v1/session"):
                said = client.get(path).headers["strict-transport-security"]
                assert said == "max-age=31536000"


OWN_ORIGINS = ["http://testserver", "https://testserver", "http://testserver:80"]
OTHER_ORIGINS = [
    *("null", "https://evil.example", "http://testserver:8080", "http://testserver.evil.example"),
    *("http://evil.example/testserver", "file://", "", "http://["),
]
#: What changes something: pages of evaluators, of experimenters, and calls.
FORMS = [
    *("/s/short/consent", "/s/short/withdraw", "/s/short/continue", "/s/short/delete"),
    *("/preview/s/short/withdraw", "/sign-in", "/sign-out", "/studies/short/close"),
    *("/api/v1/studies/short/sessions", "/api/v1/session/withdraw"),
]


@pytest.mark.parametrize("origin", OTHER_ORIGINS)
def test_without_sec_fetch_site_the_origin_has_to_be_our_own(
    client: Api, short_study: StudyInfo, api_token: str, origin: str
) -> None:
    for path in FORMS:
        refusal = client.post(path, headers={"Origin": origin})
        assert refusal.status_code == 403, path
        assert "another site" in refusal.text, path
    assert client.table("sessions", api_token).empty


@pytest.mark.parametrize("origin", OWN_ORIGINS)
def test_a_form_with_our_own_origin_is_taken(
    client: Api, short_study: StudyInfo, origin: str
) -> None:
    path = "/api/v1/studies/short/sessions"
    assert client.post(path, json={}, headers={"Origin": origin}).status_code == 201


def test_a_form_with_the_public_origin_is_taken_behind_a_proxy_that_renames_the_host(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    public = app.settings.model_copy(update={"public_url": "https://studies.lab.example"})
    object.__setattr__(app, "settings", public)
    path, headers = "/api/v1/studies/short/sessions", {"Origin": "https://studies.lab.example"}
    assert client.post(path, json={}, headers=headers).status_code == 201


def test_programs_with_a_token_need_neither_header(client: Api, short_study: StudyInfo) -> None:
    session = client.start()
    assert session.consent().status_code == 200


@pytest.mark.parametrize("path", ["/studies/", "/s/short/", "/"])
def test_a_made_up_host_leads_nobody_away(client: Api, short_study: StudyInfo, path: str) -> None:
    answer = client.get(path, headers={"Host": "evil.example"})
    assert answer.status_code in (303, 307)
    assert answer.headers["location"].startswith("/")
    assert not answer.headers["location"].startswith("//")
    twice = client.get(f"{path}/evil.example//", headers={"Host": "evil.example"})
    assert not twice.headers.get("location", "/").startswith(("//", "http"))
