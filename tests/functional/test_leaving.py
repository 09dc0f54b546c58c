"""Leaving: to stop and keep, to stop and delete, and to have deleted later with a receipt."""

from __future__ import annotations

import re

import pytest
from sqlalchemy import func, select, text

from app.services.context import AppContext
from app.services.proposals import proposer
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Base
from tests.conftest import FROM_PROLIFIC, Clock, database_file

from .client import Api, Session
from .conftest import Recruit
from .test_participant_pages import COOKIE, heading, in_browser, sent_on

PLATFORM_ID = "5f0c1ada-prolific"

#: What a study has before anybody came: everything else belongs to people.
OF_THE_STUDY = {
    *("studies", "plans", "candidates", "recordings", "accounts", "api_tokens"),
    # Of those who run it, and of nobody else.
    *("audit_events", "fault_counts", "server_secrets"),
}


@pytest.fixture
def person(client: Api, recruit: Recruit, clock: Clock) -> Session:
    """Somebody from a platform who has answered a trial and a half, with events."""
    recruit(FROM_PROLIFIC)
    session = client.start(external_ids={"PROLIFIC_PID": PLATFORM_ID}).to_first_query()
    events = [{"event": "stalled", "side": "left", "time_ms": 5, "value": "told-by-the-browser"}]
    while session.state["progress"]["trial"] < 2 or session.state["progress"]["query"] < 3:
        if session.state["stage"] == "query":
            assert session.respond("left", rt_ms=1, events=events).status_code == 200
        else:
            session.step("left", clock.forward)
    return session


def rows_of_people(app: AppContext) -> dict[str, int]:
    """How many rows each table has that holds something of a person; tombstones are counted too."""
    with app.database.read() as db:
        counted = {
            table.name: db.scalar(select(func.count()).select_from(table)) or 0
            for table in Base.metadata.sorted_tables
            if table.name not in OF_THE_STUDY
        }
    return {name: number for name, number in counted.items() if number}


def test_stopping_without_more_keeps_what_was_answered(client: Api, person: Session) -> None:
    answer = person.call("withdraw", {"delete": False}).json()
    assert answer["stage"] == "withdrawn"
    assert person.look()["stage"] == "withdrawn"


def test_stopping_with_deletion_leaves_a_tombstone_and_nothing_else(
    app: AppContext, person: Session, clock: Clock
) -> None:
    assert {"responses", "events", "identities", "preferences"} <= rows_of_people(app).keys()
    clock.forward(5 * 3600)
    answer = person.call("withdraw", {"delete": True})
    assert (answer.status_code, answer.json()["stage"]) == (200, "withdrawn")
    assert answer.json()["deleted"] is True
    assert rows_of_people(app) == {"tombstones": 1}
    with app.database.read() as db:
        stone = db.execute(text("SELECT * FROM tombstones")).mappings().one()
    assert (stone["mode"], stone["stage"]) == ("live", "query")
    assert str(stone["deleted_at"]).startswith("2026-03-01 00:00:00")


def test_a_deleted_sessions_token_is_worth_nothing(client: Api, person: Session) -> None:
    person.call("withdraw", {"delete": True})
    refusal = client.get("/api/v1/session", headers=person.headers)
    assert (refusal.status_code, refusal.json()["type"]) == (
        401,
        "urn:pbpo-studio:problem:unauthenticated",
    )
    assert person.call("withdraw", {"delete": True}).status_code == 401


def test_exports_made_afterwards_hold_nothing_of_the_person(
    client: Api, person: Session, api_token: str
) -> None:
    other = client.start().to_first_query()
    other.respond("right")
    person.call("withdraw", {"delete": True})
    stays = client.table("sessions", api_token)
    assert stays["stage"].to_list() == ["query"]
    for name in ("queries", "preferences", "acquired"):
        assert set(client.table(name, api_token)["session_id"]) <= set(stays["session_id"])
    assert client.table("identities", api_token).empty
    assert client.table("events", api_token).empty
    assert len(client.table("participants", api_token)) == 1
    deletions = client.table("deletions", api_token)
    assert deletions.to_numpy().tolist() == [
        ["short", "live", "query", "wish", "2026-03-01T00:00:00.000Z"]
    ]


@pytest.mark.sqlite
def test_nothing_of_the_person_is_left_in_the_files_of_the_database(
    app: AppContext, person: Session
) -> None:
    file = database_file(app.settings)
    files = [file, file.with_name(f"{file.name}-wal")]

    def found(what: str) -> bool:
        return any(what.encode() in path.read_bytes() for path in files if path.exists())

    with app.database.read() as db:
        pseudonym = db.scalar(text("SELECT pseudonym FROM participants")) or ""
    secrets = (PLATFORM_ID, "told-by-the-browser", pseudonym)
    assert [found(secret) for secret in secrets] == [True] * 3
    person.call("withdraw", {"delete": True})
    assert [found(secret) for secret in secrets] == [False] * 3


def test_what_was_worked_out_from_the_answers_is_forgotten(
    app: AppContext, person: Session
) -> None:
    assert app.proposer.cached_seeds()
    person.call("withdraw", {"delete": True})
    assert not app.proposer.cached_seeds()


def test_work_under_way_does_not_bring_a_deleted_trial_back(
    app: AppContext, short_study: StudyInfo
) -> None:
    trial = proposer.TrialSpec(
        study_id=short_study.id,
        environment="env1",
        method="pbpo",
        settings={"preset": "paper-env1"},
        seed=7,
        queries=4,
    )
    app.proposer.purge(frozenset({7}))
    app.proposer.step(trial, ((0, 1, "left"),))
    assert not app.proposer.cached_seeds()


@pytest.mark.parametrize("stage", ["consent", "familiarisation", "break", "completed", "withdrawn"])
def test_whoever_wants_deletion_has_it_at_any_stage(
    client: Api, app: AppContext, recruit: Recruit, clock: Clock, stage: str
) -> None:
    recruit(FROM_PROLIFIC)
    session = client.start(external_ids={"PROLIFIC_PID": "x"}).to_stage(stage, clock.forward)
    answer = session.call("withdraw", {"delete": True})
    assert answer.status_code == 200, answer.text
    assert answer.json()["stage"] == ("declined" if stage == "consent" else "withdrawn")
    assert rows_of_people(app) == {"tombstones": 1}


def test_an_expired_session_can_still_be_deleted(
    app: AppContext, person: Session, clock: Clock
) -> None:
    clock.forward(15 * 24 * 3600)
    assert person.call("withdraw").status_code == 401
    assert person.call("withdraw", {"delete": True}).status_code == 200
    assert rows_of_people(app) == {"tombstones": 1}


# With a receipt


def receipt_of(client: Api) -> tuple[str, Session]:
    answer = client.post("/api/v1/studies/short/sessions", json={}).json()
    return answer["receipt"], Session(client, answer["token"], answer["session"])


@pytest.mark.parametrize("typed", ["{}", " {} ", "lower", "spaced"])
def test_a_receipt_deletes_however_it_is_typed(
    client: Api, app: AppContext, short_study: StudyInfo, typed: str
) -> None:
    receipt, session = receipt_of(client)
    session.to_first_query().respond("left")
    assert re.fullmatch(r"[2-9B-DF-HJ-NP-TV-XZ]{4}(-[2-9B-DF-HJ-NP-TV-XZ]{4}){3}", receipt)
    written = {"lower": receipt.lower(), "spaced": receipt.replace("-", " ")}
    code = written.get(typed) or typed.format(receipt)
    answer = client.post("/api/v1/studies/short/deletions", json={"receipt": code})
    assert (answer.status_code, answer.content) == (204, b"")
    assert rows_of_people(app) == {"tombstones": 1}
    again = client.post("/api/v1/studies/short/deletions", json={"receipt": code})
    assert (again.status_code, again.json()["type"]) == (404, "urn:pbpo-studio:problem:not-found")


def test_a_receipt_of_another_study_or_of_nobody_deletes_nothing(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    receipt, _ = receipt_of(client)
    for slug, code in [("other", receipt), ("short", "AAAA-BBBB"), ("short", "-")]:
        answer = client.post(f"/api/v1/studies/{slug}/deletions", json={"receipt": code})
        assert answer.status_code == 404
    assert rows_of_people(app) == {"participants": 1, "sessions": 1}


@pytest.mark.sqlite
def test_the_database_keeps_neither_token_nor_receipt(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    receipt, session = receipt_of(client)
    dump = database_file(app.settings).read_bytes()
    for secret in (receipt, receipt.replace("-", ""), session.token):
        assert secret.encode() not in dump


# The pages


@pytest.fixture
def browsing(client: Api, short_study: StudyInfo, clock: Clock) -> Session:
    return in_browser(client, "query", clock)


def shown_receipt(client: Api, path: str = "") -> str | None:
    found = re.search(r'data-testid="receipt">([^<]+)<', client.get(f"/s/short{path}").text)
    return found and found[1]


def test_the_page_to_leave_offers_to_keep_and_to_delete(
    client: Api, app: AppContext, browsing: Session
) -> None:
    page = client.get("/s/short/withdraw").text
    assert 'data-testid="withdraw-confirm"' in page
    assert 'data-testid="withdraw-delete"' in page
    gone = client.post("/s/short/withdraw", data={"delete": "yes"})
    assert (gone.status_code, gone.headers["location"]) == (303, "/s/short/deleted?lang=en")
    assert f'{COOKIE}=""' in gone.headers["set-cookie"]
    assert heading(client.get("/s/short/deleted")) == "Everything is deleted"
    assert rows_of_people(app) == {"tombstones": 1}


def test_deleting_twice_leads_back_to_the_study(client: Api, browsing: Session) -> None:
    client.post("/s/short/withdraw", data={"delete": "yes"})
    client.cookies.set(COOKIE, browsing.token)
    sent_on(client.post("/s/short/withdraw", data={"delete": "yes"}))


def test_the_same_receipt_is_shown_from_the_agreement_to_the_press_that_ends_it(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = in_browser(client, "instructions", clock)
    first = shown_receipt(client)
    assert first
    session.to_stage("query", clock.forward)
    assert shown_receipt(client) is None
    session.to_stage("debrief", clock.forward)
    assert shown_receipt(client) == first
    sent_on(client.post("/s/short/continue"))
    assert session.look()["stage"] == "completed"
    assert shown_receipt(client) == first
    client.cookies.clear()
    answer = client.post("/api/v1/studies/short/deletions", json={"receipt": first})
    assert answer.status_code == 204


@pytest.mark.parametrize("press", ["continue", "withdraw"])
def test_after_the_end_the_receipt_is_shown_once_and_to_nobody_who_comes_from_elsewhere(
    client: Api, short_study: StudyInfo, clock: Clock, press: str
) -> None:
    in_browser(client, "debrief", clock)
    ended = client.post(f"/s/short/{press}")
    days = re.findall(rf"{COOKIE}=[^;]+;.*?Max-Age=(\d+)", str(ended.headers.multi_items()))
    assert days == [str(24 * 3600)]
    same = {"Sec-Fetch-Site": "same-origin"}
    for _ in range(2):
        # The page after the press, and that page reloaded.
        assert 'data-testid="receipt"' in client.get("/s/short", headers=same).text
    later = client.get("/s/short", headers={"Sec-Fetch-Site": "none"}).text
    assert 'data-testid="receipt"' not in later
    assert 'data-testid="somebody-else"' in later
    assert 'data-testid="receipt"' not in client.get("/s/short", headers=same).text
    clock.forward(24 * 3600)
    assert heading(client.get("/s/short")) == "Before you take part"


def test_a_receipt_is_typed_into_a_page_that_needs_no_session(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    receipt, _ = receipt_of(client)
    assert heading(client.get("/s/short/delete")) == "Delete my answers"
    wrong = client.post("/s/short/delete", data={"receipt": "<b>none"})
    assert wrong.status_code == 404
    assert 'role="alert"' in wrong.text
    assert "&lt;b&gt;none" in wrong.text
    asked = client.post("/s/short/delete", data={"receipt": receipt.lower()})
    assert (asked.status_code, rows_of_people(app)["sessions"]) == (200, 1)
    assert 'name="confirmed" value="yes"' in asked.text
    gone = client.post("/s/short/delete", data={"receipt": receipt.lower(), "confirmed": "yes"})
    assert (gone.status_code, gone.headers["location"]) == (303, "/s/short/deleted?lang=en")
    assert rows_of_people(app) == {"tombstones": 1}


@pytest.mark.parametrize("stage", ["instructions", "query", "completed", "withdrawn"])
def test_no_code_is_filled_in_that_the_person_did_not_bring(
    client: Api, short_study: StudyInfo, clock: Clock, stage: str
) -> None:
    in_browser(client, stage, clock)
    page = client.get("/s/short/delete").text
    assert 'value=""' in page
    assert not re.search(r"[2-9B-DF-HJ-NP-TV-XZ]{4}(-[2-9B-DF-HJ-NP-TV-XZ]{4}){3}", page)


def test_a_closed_study_still_deletes(client: Api, app: AppContext, short_study: StudyInfo) -> None:
    receipt, _ = receipt_of(client)
    repository.close_study(app, "short")
    given = {"receipt": receipt, "confirmed": "yes"}
    assert client.post("/s/short/delete", data=given).status_code == 303
    assert rows_of_people(app) == {"tombstones": 1}


@pytest.mark.parametrize("path", ["delete", "deleted"])
def test_pages_of_a_study_that_is_not_there_say_so(client: Api, path: str) -> None:
    assert client.get(f"/s/nowhere/{path}").status_code == 404


def test_the_experimenter_sees_how_many_were_deleted(
    client: Api, browsing: Session, api_token: str
) -> None:
    browsing.call("withdraw", {"delete": True})
    headers = {"Authorization": f"Bearer {api_token}"}
    page = client.get("/studies/short", headers=headers).text
    assert re.search(r"<dt>Deleted at their wish</dt><dd>1</dd>", page)


def test_the_page_of_the_deleted_shows_strangers_no_code(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit("recruitment: {platform: prolific, codes: {completed: DONE, withdrawn: W1THDR4WN}}\n")
    assert "W1THDR4WN" not in client.get("/s/short/deleted").text
    client.cookies.set("pbpo_deleted_short", "0" * 64)
    assert "W1THDR4WN" not in client.get("/s/short/deleted").text
    client.cookies.clear()
    in_browser(client, "query", clock)
    assert client.post("/s/short/withdraw", data={"delete": "1"}).status_code == 303
    for _ in range(2):
        assert "W1THDR4WN" in client.get("/s/short/deleted").text
