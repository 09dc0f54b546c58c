"""The experimenter's pages over HTTP: signing in, studies, one study, opening and closing it."""

from __future__ import annotations

import re

import httpx
import pytest

from app.services.context import AppContext
from app.services.export import TABLES
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api
from .conftest import EMAIL, PASSWORD

COOKIE = "pbpo_sign_in"


def form_token(page: httpx.Response) -> str:
    found = re.search(r'name="csrf_token" value="([0-9a-f]+)"', page.text)
    assert found, page.text
    return found[1]


def sign_in(
    client: Api, email: str = EMAIL, password: str = PASSWORD, **more: str
) -> httpx.Response:
    token = form_token(client.get("/sign-in"))
    given = {"email": email, "password": password, "csrf_token": token, **more}
    return client.post("/sign-in", data=given)


@pytest.fixture
def signed_in(client: Api, short_study: StudyInfo, api_token: str) -> Api:
    assert sign_in(client).status_code == 303
    return client


@pytest.mark.parametrize("path", ["/studies", "/studies/short"])
def test_whoever_is_not_signed_in_is_led_to_the_sign_in_and_back(
    client: Api, short_study: StudyInfo, api_token: str, path: str
) -> None:
    answer = client.get(path)
    assert answer.status_code == 303
    assert answer.headers["location"] == f"/sign-in?next={path}"
    page = client.get(answer.headers["location"])
    assert f'name="next" value="{path}"' in page.text
    assert sign_in(client, next=path).headers["location"] == path


def test_the_front_door_leads_to_the_studies(client: Api) -> None:
    assert client.get("/").headers["location"] == "/studies"


def test_signing_in_gives_the_browser_a_cookie_that_scripts_cannot_read(
    client: Api, api_token: str
) -> None:
    answer = sign_in(client, email=f" {EMAIL.upper()} ")
    assert (answer.status_code, answer.headers["location"]) == (303, "/studies")
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{COOKIE}=")
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    assert client.get("/studies").status_code == 200


def test_a_wrong_password_and_an_unknown_address_get_the_same_sentence(
    client: Api, api_token: str
) -> None:
    wrong, unknown = sign_in(client, password="wrong"), sign_in(client, email="bob@lab.example")
    assert (wrong.status_code, unknown.status_code) == (401, 401)
    sentence = "That address and password do not belong together."
    for page in (wrong, unknown):
        assert sentence in page.text
        assert COOKIE not in client.cookies
    assert wrong.text.replace(form_token(wrong), "") == unknown.text.replace(
        form_token(unknown), ""
    )


def test_a_form_that_is_not_ours_is_refused(client: Api, api_token: str) -> None:
    given = {"email": EMAIL, "password": PASSWORD}
    without_cookie = client.post("/sign-in", data={**given, "csrf_token": "0" * 64})
    assert without_cookie.status_code == 403
    client.get("/sign-in")
    assert client.post("/sign-in", data={**given, "csrf_token": "0" * 64}).status_code == 403
    assert client.post("/sign-in", data={**given, "csrf_token": "ü"}).status_code == 403
    assert client.post("/sign-in", data=given).status_code == 422
    assert COOKIE not in client.cookies


ELSEWHERE = ["https://evil.example/", "//evil.example", "/\\evil.example", "evil", "javascript:x()"]


@pytest.mark.parametrize("elsewhere", ELSEWHERE)
def test_signing_in_never_leads_to_another_site(
    client: Api, api_token: str, elsewhere: str
) -> None:
    page = client.get("/sign-in", params={"next": elsewhere})
    assert 'name="next" value="/studies"' in page.text
    assert sign_in(client, next=elsewhere).headers["location"] == "/studies"


def test_a_path_that_a_browser_would_read_as_a_site_stays_a_path(
    client: Api, api_token: str
) -> None:
    answer = sign_in(client, next="/\t/evil.example")
    assert answer.headers["location"] == "/%09/evil.example"


def test_signing_out_ends_the_sign_in(signed_in: Api) -> None:
    token = signed_in.cookies[COOKIE]
    csrf = form_token(signed_in.get("/studies"))
    assert signed_in.post("/sign-out", data={"csrf_token": "0"}).status_code == 403
    assert signed_in.post("/sign-out", data={"csrf_token": csrf}).status_code == 303
    signed_in.cookies.clear()
    signed_in.cookies.set(COOKIE, token)
    assert signed_in.get("/studies").status_code == 303


def test_a_sign_in_lasts_two_weeks(signed_in: Api, clock: Clock) -> None:
    clock.forward(14 * 24 * 3600 - 1)
    assert signed_in.get("/studies").status_code == 200
    clock.forward(1)
    assert signed_in.get("/studies").status_code == 303


def test_studies_are_listed_with_how_many_took_part(signed_in: Api, clock: Clock) -> None:
    signed_in.start().to_stage("completed", clock.forward)
    signed_in.start()
    signed_in.start(mode="preview")
    page = signed_in.get("/studies")
    assert "A short study" in page.text
    assert re.findall(r'<td class="number">(\d+)</td>', page.text) == ["2", "1"]
    assert EMAIL in page.text


def test_a_study_shows_its_sessions_with_stage_and_progress(signed_in: Api, clock: Clock) -> None:
    done = signed_in.start().to_stage("completed", clock.forward)
    under_way = signed_in.start().to_first_query()
    skip = "skip" if under_way.state["query"]["skip"] else "left"
    under_way.respond(skip)
    signed_in.start(mode="preview")
    assert done.state["stage"] == "completed"

    page = signed_in.get("/studies/short")
    assert page.status_code == 200, page.text
    assert "Trial 1 of 3, query 2 of 4" in page.text
    assert page.text.count("<tr data-session=") == 2
    assert signed_in.get("/studies/short?mode=preview").text.count("<tr data-session=") == 1
    assert signed_in.get("/studies/short?mode=all").text.count("<tr data-session=") == 3
    assert signed_in.get("/studies/short?mode=nonsense").text.count("<tr data-session=") == 2
    assert "http://testserver/s/short" in page.text
    plan = signed_in.get("/studies/short/plan")
    for condition in ("pbpo", "no-synthesis", "no-skip"):
        assert condition in plan.text


def test_every_table_that_the_page_links_to_can_be_downloaded(signed_in: Api) -> None:
    page = signed_in.get("/studies/short?mode=all")
    links = re.findall(r'href="(/api/v1/[^"]+)"', page.text)
    assert len(links) == len(TABLES) + 1
    for link in links:
        answer = signed_in.get(link.replace("&amp;", "&"))
        assert answer.status_code == 200, link
        assert answer.headers["content-disposition"].startswith("attachment; filename=")
        assert answer.headers["cache-control"] == "no-store"


def test_a_study_is_closed_and_opened_by_forms_of_our_own_page(
    signed_in: Api, app: AppContext
) -> None:
    csrf = {"csrf_token": form_token(signed_in.get("/studies/short"))}
    assert signed_in.post("/studies/short/close", data={"csrf_token": "0"}).status_code == 403
    assert repository.find(app, "short").status == "open"
    for action, status in (("close", "closed"), ("open", "open"), ("open", "open")):
        assert signed_in.post(f"/studies/short/{action}", data=csrf).status_code == 303
        assert repository.find(app, "short").status == status


def test_nobody_but_an_experimenter_opens_or_closes_a_study(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    answer = client.post("/studies/short/close", data={"csrf_token": "0"})
    assert (answer.status_code, answer.headers["location"][:8]) == (303, "/sign-in")
    assert repository.find(app, "short").status == "open"


def test_a_study_that_is_not_there_is_a_page_that_says_so(signed_in: Api) -> None:
    page = signed_in.get("/studies/nowhere")
    assert page.status_code == 404
    assert "nowhere" in page.text


def test_where_no_study_is_yet_the_page_says_how_to_make_one(client: Api, api_token: str) -> None:
    sign_in(client)
    assert "pbpo study create FOLDER" in client.get("/studies").text
