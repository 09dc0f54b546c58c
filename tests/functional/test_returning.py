"""The same person coming twice, known by what their platform calls them."""

from __future__ import annotations

import re

import httpx
import pytest

from app.services.arrival import admission
from app.services.context import AppContext
from app.services.runtime.ids import receipt_code
from app.services.studies import repository
from app.study.recruitment import Recruitment
from tests.conftest import Clock

from .client import Api, Session
from .conftest import Recruit
from .test_leaving import rows_of_people, shown_receipt
from .test_participant_pages import (
    COOKIE,
    HEADINGS,
    agree,
    come_back,
    heading,
    sent_on,
    token_for,
)
from .test_recruitment import CONNECT, MTURK, PROLIFIC, SONA, identities, return_link

LINK = "?PROLIFIC_PID=5f0c&SESSION_ID=first"
AGAIN = "?PROLIFIC_PID=5f0c&SESSION_ID=second"
#: What a stranger can know of somebody.
ALONE = "?PROLIFIC_PID=5f0c"
KNOWN = "You have begun already"


def recruitment(returning: str) -> str:
    return f"{PROLIFIC}  returning: {returning}\n"


def in_another_browser(client: Api) -> None:
    client.cookies.clear()


def session_of(client: Api, clock: Clock, stage: str) -> Session:
    """The browser's own session, brought to a stage."""
    token = client.cookies[COOKIE]
    db = Session(client, token, {})
    db.look()
    return db.to_stage(stage, clock.forward)


def sessions_and_people(app: AppContext) -> tuple[int, int]:
    rows = rows_of_people(app)
    return rows.get("sessions", 0), rows.get("participants", 0)


def test_taking_people_back_is_what_happens_unless_the_study_says_otherwise() -> None:
    assert Recruitment().returning == "resume"


def test_whoever_comes_back_in_another_browser_goes_on_where_they_were_by_a_press(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    before = session_of(client, clock, "query").look()
    in_another_browser(client)

    page = client.get(f"/s/short{LINK}")
    assert (page.status_code, heading(page)) == (409, KNOWN)
    assert 'data-testid="return-to-session"' in page.text
    assert COOKIE not in client.cookies
    sent_on(come_back(client, LINK))
    assert heading(client.get("/s/short")) == HEADINGS["query"]
    after = client.get("/api/v1/session", headers={"PBPO-Study": "short"}).json()
    assert after["query"]["id"] == before["query"]["id"]
    assert sessions_and_people(app) == (1, 1)


@pytest.mark.parametrize("stage", ["query", "completed"])
@pytest.mark.parametrize("link", [ALONE, AGAIN, f"{ALONE}&SESSION_ID={{{{%SESSION_ID%}}}}"])
def test_a_platforms_id_alone_leads_nobody_into_a_session(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, link: str, stage: str
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, stage)
    in_another_browser(client)
    kept = rows_of_people(app)
    page = client.get(f"/s/short{link}")
    assert (page.status_code, heading(page)) == (409, KNOWN)
    assert "the receipt code that you were given" in page.text
    assert 'data-testid="return-to-session"' not in page.text
    version = admission.landing_page(app, "short").consent["version"]
    for press in ("return", "claim"):
        client.post(f"/s/short/{press}{link}")
    agreed = client.post(f"/s/short/consent{link}", data={"version": version})
    assert (agreed.status_code, heading(agreed)) == (409, KNOWN)
    assert COOKIE not in client.cookies
    assert rows_of_people(app) == kept
    assert identities(client, token_for(app)) == {"PROLIFIC_PID": "5f0c", "SESSION_ID": "first"}


def test_a_survey_code_of_sona_is_no_proof(client: Api, recruit: Recruit, app: AppContext) -> None:
    recruit(SONA)
    agree(client, "?id=4711")
    in_another_browser(client)
    assert heading(client.get("/s/short?id=4711")) == KNOWN
    assert heading(come_back(client, "?id=4711")) == KNOWN
    assert sessions_and_people(app) == (1, 1)


@pytest.mark.parametrize(
    ("plan", "own", "other"),
    [
        (CONNECT, "participantId=p&assignmentId=a&projectId=x", "participantId=p&assignmentId=b"),
        (MTURK, "workerId=W1&assignmentId=A1", "workerId=W1&assignmentId=A2"),
    ],
)
def test_every_platform_with_an_id_of_the_submission_leads_back_by_it(
    client: Api, recruit: Recruit, app: AppContext, plan: str, own: str, other: str
) -> None:
    recruit(plan)
    agree(client, f"?{own}")
    in_another_browser(client)
    assert come_back(client, f"?{other}").status_code == 409
    sent_on(come_back(client, f"?{own}"))
    assert heading(client.get("/s/short")) == "What you will do"
    assert sessions_and_people(app) == (1, 1)


def test_looking_at_a_link_writes_nothing_and_each_return_replaces_the_one_before(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    tokens: list[str] = []
    for _ in range(5):
        in_another_browser(client)
        for _ in range(3):
            client.get(f"/s/short{LINK}", headers={"Sec-Purpose": "prefetch"})
        assert rows_of_people(app).get("reentries", 0) == min(len(tokens), 1)
        sent_on(come_back(client, LINK))
        tokens.append(client.cookies[COOKIE])
    assert rows_of_people(app)["reentries"] == 1
    statuses = [
        client.get("/api/v1/session", headers={"Authorization": f"Bearer {token}"}).status_code
        for token in tokens
    ]
    assert statuses == [401, 401, 401, 401, 200]


def test_a_browser_that_came_back_by_ids_sees_no_receipt_and_deletes_nothing(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    first_receipt = shown_receipt(client)
    first = session_of(client, clock, "instructions")
    in_another_browser(client)
    sent_on(come_back(client, LINK))
    token = client.cookies[COOKIE]
    assert shown_receipt(client) is None
    assert "withdraw-delete" not in client.get("/s/short/withdraw").text
    client.post("/s/short/withdraw", data={"delete": "yes"})
    authorization = {"Authorization": f"Bearer {token}"}
    refused = client.post("/api/v1/session/withdraw", json={"delete": True}, headers=authorization)
    assert refused.status_code == 403
    body = {"receipt": receipt_code(token)}
    assert client.post("/api/v1/studies/short/deletions", json=body).status_code == 404
    assert first.look()["stage"] == "instructions"

    gone = client.post("/api/v1/studies/short/deletions", json={"receipt": first_receipt})
    assert gone.status_code == 204
    assert rows_of_people(app) == {"tombstones": 1}


def test_the_receipt_code_leads_back_and_lets_one_do_everything(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    receipt = shown_receipt(client) or ""
    in_another_browser(client)
    wrong = come_back(client, ALONE, receipt="not this one")
    assert (wrong.status_code, heading(wrong)) == (404, KNOWN)
    assert 'role="alert"' in wrong.text
    sent_on(come_back(client, ALONE, receipt=receipt.lower()))
    assert heading(client.get("/s/short")) == "What you will do"
    assert shown_receipt(client) not in (None, receipt)
    client.post("/s/short/withdraw", data={"delete": "yes"})
    assert rows_of_people(app) == {"tombstones": 1}


@pytest.mark.parametrize("days", [0, 3])
def test_whoever_has_completed_finds_the_code_again(
    client: Api, recruit: Recruit, clock: Clock, days: int
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "completed")
    in_another_browser(client)
    clock.forward(days * 24 * 3600)
    come_back(client, LINK)
    assert (return_link(client.get("/s/short").text) or "").endswith("cc=COMPLETE1")


def test_taken_back_even_into_a_study_that_is_closed_by_now(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "query")
    repository.close_study(app, "short")
    in_another_browser(client)
    sent_on(come_back(client, LINK))
    assert heading(client.get("/s/short")) == HEADINGS["query"]


def test_a_session_that_was_left_for_too_long_is_begun_again(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    clock.forward(15 * 24 * 3600)
    in_another_browser(client)
    assert heading(client.get(f"/s/short{AGAIN}")) == HEADINGS["consent"]
    sent_on(agree(client, AGAIN))
    assert sessions_and_people(app) == (2, 2)


@pytest.mark.parametrize("stage", ["query", "completed"])
@pytest.mark.parametrize("link", [LINK, ALONE, AGAIN])
def test_a_study_that_takes_each_person_once_says_so_on_a_page_of_its_own(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, stage: str, link: str
) -> None:
    recruit(recruitment("block"))
    agree(client, LINK)
    session_of(client, clock, stage)
    in_another_browser(client)
    page = client.get(f"/s/short{link}")
    assert (page.status_code, heading(page)) == (409, "You have taken part already")
    assert COOKIE not in client.cookies
    # Whoever comes back for the code alone still gets it; who knows their id alone does not.
    code = return_link(page.text)
    assert (code is not None) == (stage == "completed" and link == LINK)
    assert sessions_and_people(app) == (1, 1)


def test_a_second_window_that_agrees_later_is_stopped_as_well(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(recruitment("block"))
    page = client.get(f"/s/short{LINK}")
    found = re.search(r'name="version" value="([0-9a-f]+)"', page.text)
    assert found
    agree(client, LINK)
    in_another_browser(client)
    late = client.post(f"/s/short/consent{LINK}", data={"version": found[1]})
    assert (late.status_code, heading(late)) == (409, "You have taken part already")
    assert sessions_and_people(app) == (1, 1)


def test_a_study_may_take_a_person_as_often_as_they_come_and_joins_nobody_by_an_id(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("again"))
    for link in (LINK, AGAIN):
        sent_on(agree(client, link))
        session = session_of(client, clock, "completed")
        in_another_browser(client)
    assert sessions_and_people(app) == (2, 2)
    table = client.table("identities", token_for(app))
    assert sorted(table["value"]) == ["5f0c", "5f0c", "first", "second"]
    # Whoever begins under somebody's id can delete what they gave themselves, and no more.
    session.call("withdraw", {"delete": True})
    assert sessions_and_people(app) == (1, 1)


def test_in_the_same_browser_a_further_submission_begins_a_further_session(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("again"))
    agree(client, LINK)
    session_of(client, clock, "completed")
    assert heading(client.get(f"/s/short{LINK}")) == HEADINGS["completed"]
    sent_on(agree(client, AGAIN))
    assert sessions_and_people(app) == (2, 2)


def test_whoever_had_everything_deleted_or_declined_is_a_newcomer_again(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(recruitment("block"))
    ids = {"PROLIFIC_PID": "5f0c"}
    client.start(external_ids=ids).call("withdraw")
    client.start(external_ids=ids).call("withdraw", {"delete": True})
    assert heading(client.get(f"/s/short{LINK}")) == HEADINGS["consent"]


def test_on_a_shared_computer_the_next_person_does_not_find_the_last_ones_session(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "completed")
    other = "?PROLIFIC_PID=somebody-else"
    assert heading(client.get(f"/s/short{other}")) == HEADINGS["consent"]
    sent_on(agree(client, other))
    assert sessions_and_people(app) == (2, 2)
    assert heading(client.get(f"/s/short{other}")) == "What you will do"
    assert heading(client.get("/s/short")) == "What you will do"


# By the API


def begin(client: Api, **body: object) -> httpx.Response:
    return client.post("/api/v1/studies/short/sessions", json=body)


def test_by_the_api_strangers_are_not_taken_back_and_experimenters_programs_are(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    ids = {"PROLIFIC_PID": "5f0c", "SESSION_ID": "first"}
    recruit(recruitment("resume"))
    first = Session(client, begin(client, external_ids=ids).json()["token"], {})
    first.look()
    first.to_first_query()
    for known in (ids, {"prolific_pid": " 5f0c "}):
        refused = begin(client, external_ids=known)
        assert refused.status_code == 409
        assert refused.json()["type"] == "urn:pbpo-studio:problem:known-person"
    headers = {"Authorization": f"Bearer {token_for(app)}"}
    path = "/api/v1/studies/short/sessions"
    back = client.post(path, json={"external_ids": ids}, headers=headers).json()
    assert back["session"]["stage"] == "query"
    assert back["token"] != first.token
    assert sessions_and_people(app) == (1, 1)


def test_the_api_refuses_with_a_type_of_its_own(client: Api, recruit: Recruit) -> None:
    recruit(recruitment("block"))
    begin(client, external_ids={"PROLIFIC_PID": "5f0c"})
    refusal = begin(client, external_ids={"PROLIFIC_PID": "5f0c"})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:already-taken-part"
    assert begin(client, external_ids={"PROLIFIC_PID": "other"}).status_code == 201
    assert begin(client).status_code == 201


def test_a_preview_is_nobodys_first_time(client: Api, recruit: Recruit, app: AppContext) -> None:
    recruit(recruitment("block"))
    ids = {"PROLIFIC_PID": "5f0c"}
    client.start(mode="preview", by=token_for(app), external_ids=ids)
    assert begin(client, external_ids=ids).status_code == 201


def test_without_a_platform_nobody_is_recognised(client: Api, recruit: Recruit) -> None:
    recruit("\nrecruitment: {returning: block}\n")
    for _ in range(2):
        sent_on(agree(client, "?PROLIFIC_PID=5f0c"))
        in_another_browser(client)
