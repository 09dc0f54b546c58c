"""Previews: an experimenter's look at the pages, which nobody else is given."""

from __future__ import annotations

import httpx
import pytest

from app.services.accounts import accounts, administration
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.ids import receipt_code
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api, Session
from .conftest import EMAIL, Recruit
from .desk import Desk
from .test_experimenter_pages import signed_in
from .test_participant_pages import HEADINGS, agree, heading, token_for, version

__all__ = ["signed_in"]

HERE = "/preview/s/short"
SESSIONS = "/api/v1/studies/short/sessions"
CODES = """
recruitment:
  platform: prolific
  codes: {completed: CODE-OF-COMPLETION, screened_out: CODE-OF-SCREENING, technical: CODE-OF-FAULTS,
    declined: CODE-OF-DECLINING, withdrawn: CODE-OF-WITHDRAWAL}
"""


@pytest.fixture
def desk(client: Api, app: AppContext, short_study: StudyInfo) -> Desk:
    return Desk(client, app, EMAIL, Role.ADMIN)


def agree_in_preview(client: Api) -> httpx.Response:
    page = client.get(HERE)
    return client.post(f"{HERE}/consent", data={"version": version(page)})


def modes(client: Api, api_token: str) -> list[str]:
    return sorted(client.table("sessions", api_token, "all")["mode"])


@pytest.mark.parametrize("said", ["", "recruitment: {links: single-use}\n", CODES])
def test_a_stranger_begins_no_preview_in_any_study(
    client: Api, recruit: Recruit, said: str
) -> None:
    recruit(said)
    refusal = client.post(SESSIONS, json={"mode": "preview"})
    assert (refusal.status_code, refusal.json()["type"]) == (
        403,
        "urn:pbpo-studio:problem:forbidden",
    )
    assert client.get(HERE).status_code == 403
    assert client.post(f"{HERE}/consent", data={"version": "x"}).status_code == 403


def test_a_sessions_own_token_is_no_experimenters(client: Api, short_study: StudyInfo) -> None:
    headers = client.start().headers
    assert client.post(SESSIONS, json={"mode": "preview"}, headers=headers).status_code == 403


def test_a_preview_is_walked_like_the_study_and_says_what_it_is(desk: Desk, clock: Clock) -> None:
    client = desk.client
    begun = desk.post("/studies/short/preview")
    assert (begun.status_code, begun.headers["location"]) == (303, HERE)
    page = client.get(HERE)
    assert heading(page) == HEADINGS["consent"]
    sent = agree_in_preview(client)
    assert (sent.status_code, sent.headers["location"]) == (303, HERE)
    for path in (HERE, f"{HERE}/withdraw", f"{HERE}/privacy"):
        page = client.get(path)
        assert page.status_code == 200, path
        assert 'data-testid="mode-preview"' in page.text, path
        assert 'href="/studies/short" data-testid="leave-preview"' in page.text
        assert 'href="/s/' not in page.text
        assert 'action="/s/' not in page.text
    # The page's calls say which cookie is meant.
    told = client.get("/api/v1/session", headers={"PBPO-Study": "preview/short"})
    assert told.json()["stage"] == "instructions"


def test_pages_of_those_who_take_part_say_nothing_of_previews(
    client: Api, short_study: StudyInfo
) -> None:
    agree(client)
    assert "preview" not in client.get("/s/short").text


def test_a_preview_ends_with_the_sign_out(desk: Desk) -> None:
    client = desk.client
    agree_in_preview(client)
    desk.post("/sign-out")
    header = {"PBPO-Study": "preview/short"}
    assert client.get(HERE).status_code == 403
    assert client.post(f"{HERE}/continue").status_code == 403
    assert client.get("/api/v1/session", headers=header).status_code == 403


@pytest.mark.parametrize("signs_out", [True, False])
def test_a_participants_link_after_a_preview_begins_a_live_session(
    desk: Desk, app: AppContext, signs_out: bool
) -> None:
    client = desk.client
    agree_in_preview(client)
    if signs_out:
        desk.post("/sign-out")
    assert heading(client.get("/s/short")) == HEADINGS["consent"]
    agree(client)
    told = client.get("/api/v1/session", headers={"PBPO-Study": "short"})
    assert told.json()["stage"] == "instructions"
    api_token = accounts.create_api_token(app, desk.account, "tests")
    assert modes(client, api_token) == ["live", "preview"]


def test_a_cookie_of_a_live_session_is_not_taken_for_a_preview(desk: Desk) -> None:
    session = desk.client.start().to_first_query()
    desk.client.cookies.set("pbpo_session_short", session.token)
    assert heading(desk.client.get(HERE)) == HEADINGS["consent"]


@pytest.mark.parametrize("end", ["completed", "withdrawn", "declined"])
def test_no_preview_is_given_a_code(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, end: str
) -> None:
    recruit(CODES)
    desk = Desk(client, app, EMAIL, Role.ADMIN)
    session = client.start(mode="preview").to_stage(end, clock.forward)
    client.cookies.set("pbpo_preview_session_short", session.token)
    page = client.get(HERE)
    assert page.status_code == 200
    declined = client.post(f"{HERE}/decline")
    for text in (page.text, declined.text, str(session.state), client.get(f"{HERE}/deleted").text):
        assert "CODE-OF" not in text
    assert desk.account


def test_a_preview_begins_again_in_another_language(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    desk = Desk(client, app, EMAIL, Role.ADMIN)
    begun = desk.post("/studies/short/preview", language="en")
    assert begun.headers["location"] == f"{HERE}?lang=en"
    assert desk.post("/studies/short/preview", language="xx").headers["location"] == HERE


def test_previews_are_bounded_also_in_a_study_of_single_use_links(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("recruitment: {links: single-use}\n")
    token = token_for(app)
    few = app.settings.model_copy(update={"begun_per_hour": 3})
    object.__setattr__(app, "settings", few)
    for _ in range(3):
        client.start(mode="preview", by=token)
    headers = {"Authorization": f"Bearer {token}"}
    assert client.post(SESSIONS, json={"mode": "preview"}, headers=headers).status_code == 429


def test_previews_take_no_room_from_those_who_take_part(
    client: Api, short_study: StudyInfo, app: AppContext
) -> None:
    token = token_for(app)
    few = app.settings.model_copy(update={"begun_per_hour": 3})
    object.__setattr__(app, "settings", few)
    for _ in range(3):
        client.start(mode="preview", by=token)
    assert isinstance(client.start(), Session)


def test_a_previews_token_ends_with_the_sign_in_it_was_begun_with(desk: Desk) -> None:
    client = desk.client
    agree_in_preview(client)
    token = client.cookies["pbpo_preview_session_short"]
    bearer = {"Authorization": f"Bearer {token}"}
    assert client.get("/api/v1/session", headers=bearer).status_code == 200
    desk.post("/sign-out")
    client.cookies.clear()
    assert client.get("/api/v1/session", headers=bearer).status_code == 403


def test_a_previews_token_ends_with_the_api_token_it_was_begun_with(
    desk: Desk, app: AppContext
) -> None:
    client = desk.client
    api_token = accounts.create_api_token(app, desk.account, "tests")
    client.cookies.clear()
    session = client.start(mode="preview", by=api_token)
    bearer = {"Authorization": f"Bearer {session.token}"}
    assert client.get("/api/v1/session", headers=bearer).status_code == 200
    accounts.create(app, "another@lab.example", "correct horse battery", Role.ADMIN)
    administration.disable(app, desk.account.email, "tests")
    assert client.get("/api/v1/session", headers=bearer).status_code == 403


def test_a_previews_token_in_the_cookie_of_another_address_is_no_session(desk: Desk) -> None:
    client = desk.client
    agree_in_preview(client)
    token = client.cookies["pbpo_preview_session_short"]
    desk.post("/sign-out")
    for mode, prefix in (("", ""), ("pilot_", "/pilot"), ("preview_", "/preview")):
        client.cookies.clear()
        client.cookies.set(f"pbpo_{mode}session_short", token)
        page = client.get(f"{prefix}/s/short")
        assert page.status_code == 403 or heading(page) == HEADINGS["consent"]
        header = {"PBPO-Study": f"{prefix.removeprefix('/')}/short".removeprefix("/")}
        call = client.get("/api/v1/session", headers=header)
        assert call.status_code in (401, 403), (prefix, call.text)


def test_the_receipt_of_a_preview_leads_into_nothing(desk: Desk) -> None:
    client = desk.client
    agree_in_preview(client)
    receipt = receipt_code(client.cookies["pbpo_preview_session_short"])
    desk.post("/sign-out")
    client.get("/s/short")
    answer = client.post("/s/short/return", data={"receipt": receipt})
    assert answer.status_code == 404
    assert heading(client.get("/s/short")) == HEADINGS["consent"]
