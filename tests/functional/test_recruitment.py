"""People who come from a platform: what is kept of their link, and how they get back."""

from __future__ import annotations

import html
import re
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.services.context import AppContext
from app.services.sessions import advance, completion
from app.services.studies.repository import StudyInfo
from app.study.stages import FINAL_STAGES
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .test_leaving import rows_of_people
from .test_participant_pages import COOKIE, agree, heading, in_browser, token_for

PROLIFIC = """
recruitment:
  platform: prolific
  codes: {completed: COMPLETE1, declined: NOTHANKS2, withdrawn: LEFT3, technical: OURFAULT4}
"""
CONNECT = "\nrecruitment: {platform: connect, codes: {completed: COMPLETE1}}\n"
SONA = """
recruitment:
  platform: sona
  parameter: id
  return_urls: {completed: "https://s.sona-systems.com/webstudy_credit.aspx?experiment_id=1"}
"""
MTURK = "\nrecruitment: {platform: mturk, codes: {completed: COMPLETE1}}\n"
LINK = "?PROLIFIC_PID=5f0c&STUDY_ID=77&SESSION_ID=sx&utm_source=mail"
BACK_TO_PROLIFIC = "https://app.prolific.com/submissions/complete?cc="
TURK = "workerId=W1&hitId=H1&turkSubmitTo=https%3A%2F%2Fworkersandbox.mturk.com"


def identities(client: Api, api_token: str) -> dict[str, str]:
    rows = client.table("identities", api_token)[["key", "value"]].to_numpy().tolist()
    return {key: str(value) for key, value in rows}


def return_link(page: str) -> str | None:
    found = re.search(r'<a [^>]*href="([^"]+)"[^>]*data-testid="return"', page)
    return html.unescape(found[1]) if found else None


def to_the_end_in_browser(client: Api, link: str, clock: Clock) -> str:
    """Enter by this link, go all the way by the pages, and see the last one."""
    agree(client, link)
    headers = {"PBPO-Study": "short"}
    while (state := client.get("/api/v1/session", headers=headers).json())["stage"] != "completed":
        if state["stage"] == "query":
            body = {"query_id": state["query"]["id"], "response": "right", "rt_ms": 1}
            client.post("/api/v1/session/responses", json=body, headers=headers)
            continue
        clock.forward(state.get("break", {}).get("seconds_left", 0))
        client.post("/s/short/continue")
    return client.get("/s/short").text


def test_only_the_platforms_own_parameters_are_kept(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(PROLIFIC)
    api_token = token_for(app)
    agree(client, LINK)
    assert identities(client, api_token) == {
        "PROLIFIC_PID": "5f0c",
        "STUDY_ID": "77",
        "SESSION_ID": "sx",
    }
    assert client.table("sessions", api_token)["platform"].to_list() == ["prolific"]


def test_a_program_too_may_leave_only_the_platforms_ids(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(PROLIFIC)
    api_token = token_for(app)
    refused = client.post(
        "/api/v1/studies/short/sessions",
        json={"external_ids": {"PROLIFIC_PID": "5f0c", "email": "me@example.org"}},
    )
    assert refused.status_code == 422
    assert refused.json()["type"].endswith(":undeclared-identifier")
    assert "'email'" in refused.json()["detail"]
    assert rows_of_people(app) == {}
    client.start(external_ids={"PROLIFIC_PID": "5f0c"})
    assert identities(client, api_token) == {"PROLIFIC_PID": "5f0c"}


@pytest.mark.parametrize("key", ["email", "PROLIFIC_PID", "workerId", "survey_code"])
def test_without_a_platform_no_identifier_is_kept_whatever_comes(
    client: Api, short_study: StudyInfo, app: AppContext, key: str
) -> None:
    api_token = token_for(app)
    assert agree(client, f"?{key}=5f0c").status_code == 303
    for headers in ({}, {"Authorization": f"Bearer {api_token}"}):
        refused = client.post(
            "/api/v1/studies/short/sessions",
            json={"external_ids": {key: "5f0c"}},
            headers=headers,
        )
        assert refused.status_code == 422, refused.text
    assert client.table("identities", api_token).empty


def test_whoever_completes_is_shown_the_code_and_the_way_back(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    page = to_the_end_in_browser(client, LINK, clock)
    assert heading_of(page) == "Thank you"
    assert return_link(page) == f"{BACK_TO_PROLIFIC}COMPLETE1"
    assert 'data-testid="completion-code">COMPLETE1<' in page
    state = client.get("/api/v1/session", headers={"PBPO-Study": "short"}).json()
    assert state["completed"] == {
        "code": "COMPLETE1",
        "url": f"{BACK_TO_PROLIFIC}COMPLETE1",
        "platform": "Prolific",
    }


def heading_of(page: str) -> str:
    found = re.search(r"<h1[^>]*>(.*?)</h1>", page, re.DOTALL)
    assert found
    return found[1].strip()


def test_a_newcomer_who_agreed_to_an_older_text_does_not_lose_their_ids(
    client: Api, recruit: Recruit
) -> None:
    recruit(PROLIFIC)
    answer = client.post(f"/s/short/consent{LINK}", data={"version": "0" * 12})
    assert (answer.status_code, answer.headers["location"]) == (303, f"/s/short{LINK}")


def test_no_code_is_shown_before_the_end(client: Api, recruit: Recruit, clock: Clock) -> None:
    recruit(PROLIFIC)
    session = in_browser(client, "consent", clock)
    while session.look()["stage"] != "completed":
        assert "COMPLETE1" not in client.get("/s/short").text
        assert "COMPLETE1" not in str(session.state)
        session.step("left", clock.forward)


def test_declining_and_stopping_have_codes_of_their_own(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    declined = client.post(f"/s/short/decline{LINK}").text
    assert return_link(declined) == f"{BACK_TO_PROLIFIC}NOTHANKS2"
    session = in_browser(client, "query", clock)
    state = session.call("withdraw").json()
    assert state["withdrawn"]["code"] == "LEFT3"
    assert return_link(client.get("/s/short").text) == f"{BACK_TO_PROLIFIC}LEFT3"


def test_whoever_has_everything_deleted_still_gets_back(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    in_browser(client, "query", clock)
    client.post("/s/short/withdraw", data={"delete": "yes"})
    assert return_link(client.get("/s/short/deleted").text) == f"{BACK_TO_PROLIFIC}LEFT3"


def test_a_study_without_recruitment_shows_no_code(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = in_browser(client, "completed", clock)
    assert "completed" not in session.look()
    assert 'data-testid="return"' not in client.get("/s/short").text


def test_connect_leads_back_to_the_project_of_the_link(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(CONNECT)
    page = to_the_end_in_browser(client, "?participantId=p&assignmentId=a&projectId=AB12", clock)
    back = "https://connect.cloudresearch.com/participant/project/AB12/complete"
    assert return_link(page) == back


def test_sona_credits_the_code_of_the_link(client: Api, recruit: Recruit, clock: Clock) -> None:
    recruit(SONA)
    page = to_the_end_in_browser(client, "?id=4711", clock)
    back = "https://s.sona-systems.com/webstudy_credit.aspx?experiment_id=1&survey_code=4711"
    assert return_link(page) == back


# Mechanical Turk


def test_a_preview_on_mturk_can_be_read_and_not_begun(
    client: Api, app: AppContext, recruit: Recruit
) -> None:
    recruit(MTURK)
    page = client.get(f"/s/short?assignmentId=ASSIGNMENT_ID_NOT_AVAILABLE&{TURK}")
    assert page.status_code == 200
    assert "You choose between videos." in page.text
    assert "<form" not in page.text
    policy = page.headers["content-security-policy"]
    assert "frame-ancestors https://worker.mturk.com https://workersandbox.mturk.com;" in policy


def test_in_mturks_frame_the_study_opens_in_a_window_of_its_own(
    client: Api, recruit: Recruit
) -> None:
    recruit(MTURK)
    link = f"?assignmentId=A1&{TURK}"
    framed = client.get(f"/s/short{link}", headers={"Sec-Fetch-Dest": "iframe"})
    assert "frame-ancestors https://worker.mturk.com" in framed.headers["content-security-policy"]
    opened = re.search(r'href="([^"]+)" target="_blank"', framed.text)
    assert opened
    assert html.unescape(opened[1]) == f"/s/short{link}"
    page = client.get(f"/s/short{link}", headers={"Sec-Fetch-Dest": "document"})
    assert heading(page) == "Before you take part"
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]


def test_a_browser_that_says_nothing_of_frames_finds_the_door_and_then_the_study(
    client: Api, recruit: Recruit
) -> None:
    recruit(MTURK)
    link = f"?assignmentId=A1&{TURK}"
    framed = client.get(f"/s/short{link}")
    assert "frame-ancestors https://worker.mturk.com" in framed.headers["content-security-policy"]
    opened = re.search(r'href="([^"]+)" target="_blank"', framed.text)
    assert opened
    page = client.get(html.unescape(opened[1]))
    assert heading(page) == "Before you take part"
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]


def test_a_result_is_sent_to_mturk_by_a_form(client: Api, recruit: Recruit, clock: Clock) -> None:
    recruit(MTURK)
    page = to_the_end_in_browser(client, f"?assignmentId=A1&{TURK}&opened_in=window", clock)
    assert 'action="https://workersandbox.mturk.com/mturk/externalSubmit"' in page
    assert 'name="assignmentId" value="A1"' in page
    assert 'name="code" value="COMPLETE1"' in page
    policy = client.get("/s/short").headers["content-security-policy"]
    assert re.search(r"form-action 'self' [^;]*https://workersandbox\.mturk\.com", policy)
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize("said", ["", PROLIFIC])
def test_no_other_study_may_be_framed(client: Api, recruit: Recruit, said: str) -> None:
    recruit(said)
    page = client.get("/s/short?assignmentId=A1", headers={"Sec-Fetch-Dest": "iframe"})
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]


# When something of ours fails


def full_disk(*_: Any, **__: Any) -> Any:
    raise OperationalError("INSERT", {"id": "5f0c-secret"}, Exception("disk is full"))


@pytest.mark.parametrize(("stage", "code"), [("query", "OURFAULT4"), ("debrief", "COMPLETE1")])
def test_a_failure_of_ours_never_withholds_the_way_back(
    client: Api,
    recruit: Recruit,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    stage: str,
    code: str,
) -> None:
    recruit(PROLIFIC)
    in_browser(client, stage, clock)
    monkeypatch.setattr(advance, "continue_session", full_disk)
    page = client.post("/s/short/continue")
    assert (page.status_code, heading(page)) == (500, "Something of ours has failed")
    assert return_link(page.text) == f"{BACK_TO_PROLIFIC}{code}"
    assert "default-src 'none'" in page.headers["content-security-policy"]


def test_the_way_back_is_known_even_without_the_database(
    client: Api, recruit: Recruit, app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    recruit(PROLIFIC)
    client.get(f"/s/short{LINK}")
    monkeypatch.setattr(app.database, "read", full_disk)
    page = client.get(f"/s/short{LINK}")
    assert page.status_code == 500
    assert return_link(page.text) == f"{BACK_TO_PROLIFIC}OURFAULT4"
    client.cookies.set(COOKIE, "any")
    assert client.get("/s/short").status_code == 500


def test_an_error_of_the_database_does_not_say_what_it_was_about(app: AppContext) -> None:
    with (
        pytest.raises(Exception, match=r"no such table|does not exist") as caught,
        app.database.write() as db,
    ):
        db.execute(text("INSERT INTO nowhere VALUES (:pid)"), {"pid": "5f0c-secret"})
    assert "5f0c-secret" not in str(caught.value)


def test_every_ending_has_an_outcome() -> None:
    assert completion.OUTCOMES.keys() == FINAL_STAGES
