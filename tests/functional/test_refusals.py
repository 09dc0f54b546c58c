"""What the API refuses, and how it says so: problem+json with a stable type."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from sqlalchemy import event

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api

PREFIX = "urn:pbpo-studio:problem:"


def problem(response: httpx.Response, status: int, name: str) -> dict[str, Any]:
    """The problem that the response is; fails unless it is this one."""
    assert (response.status_code, response.headers["content-type"]) == (
        status,
        "application/problem+json",
    ), response.text
    answer: dict[str, Any] = response.json()
    assert answer["type"] == PREFIX + name
    assert answer["status"] == status
    assert answer["title"]
    assert answer["detail"]
    return answer


def test_an_unknown_study_is_not_found(client: Api) -> None:
    response = client.post("/api/v1/studies/nowhere/sessions", json={})
    assert "nowhere" in problem(response, 404, "not-found")["detail"]


def test_an_unknown_address_is_not_found_and_a_wrong_method_is_named(client: Api) -> None:
    problem(client.get("/api/v1/nothing"), 404, "not-found")
    refusal = client.get("/api/v1/session/consent")
    problem(refusal, 405, "method-not-allowed")
    assert refusal.headers["allow"] == "POST"


def test_without_a_token_a_session_is_nobodys(client: Api, short_study: StudyInfo) -> None:
    client.start()
    wrong: list[dict[str, str]] = [{}, {"Authorization": "Basic abc"}, {"PBPO-Study": "short"}]
    for headers in wrong:
        refusal = client.get("/api/v1/session", headers=headers)
        problem(refusal, 401, "unauthenticated")
        assert refusal.headers["www-authenticate"] == "Bearer"


def test_a_token_that_nobody_was_given_opens_no_session(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    for token in ("made-up", api_token):
        headers = {"Authorization": f"Bearer {token}"}
        problem(client.get("/api/v1/session", headers=headers), 401, "unauthenticated")
        problem(client.post("/api/v1/session/continue", headers=headers), 401, "unauthenticated")


def test_a_session_left_for_two_weeks_has_expired(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()
    clock.forward(14 * 24 * 3600)
    problem(client.get("/api/v1/session", headers=session.headers), 401, "session-expired")
    problem(session.respond("left"), 401, "session-expired")
    problem(session.go_on(), 401, "session-expired")


def test_a_session_that_is_over_can_still_be_looked_at_later(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start()
    session.call("withdraw")
    clock.forward(30 * 24 * 3600)
    assert session.look()["stage"] == "declined"


def test_a_cookie_alone_is_no_token_for_the_api(client: Api, short_study: StudyInfo) -> None:
    session = client.start()
    client.cookies.set("pbpo_session_short", session.token)
    problem(client.post("/api/v1/session/continue"), 401, "unauthenticated")
    refusal = client.post("/api/v1/session/continue", headers={"PBPO-Study": "short"})
    assert problem(refusal, 409, "out-of-order")["stage"] == "consent"


def test_another_sessions_query_is_not_found(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    mine, theirs = client.start().to_first_query(), client.start().to_first_query()
    body = {"query_id": theirs.state["query"]["id"], "response": "left"}
    problem(mine.call("responses", body), 404, "not-found")
    assert client.table("queries", api_token)["response"].isna().all()


def test_the_same_response_twice_is_stored_once(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    body = {
        "query_id": session.state["query"]["id"],
        "response": "left",
        "rt_ms": 900,
        "replays": 2,
        "events": [{"event": "playing", "side": "left", "time_ms": 12.5}],
    }
    first, again = session.call("responses", body), session.call("responses", body)

    assert (first.status_code, again.status_code) == (200, 200)
    shown, shown_again = first.json(), again.json()
    assert shown["query"]["id"] == shown_again["query"]["id"]
    assert shown["progress"] == shown_again["progress"]
    tables = {name: client.table(name, api_token) for name in ("queries", "preferences", "events")}
    assert tables["queries"]["response"].dropna().to_list() == ["left"]
    assert len(tables["preferences"]) == 1
    assert len(tables["events"]) == 2


def test_the_same_response_is_taken_again_wherever_the_session_has_come_to(
    client: Api, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    first = session.state["query"]["id"]
    for _ in range(4):
        session.respond("left")
    again = session.call("responses", {"query_id": first, "response": "left"})
    assert (again.status_code, again.json()["stage"]) == (200, "break")
    session.call("withdraw")
    again = session.call("responses", {"query_id": first, "response": "left"})
    assert (again.status_code, again.json()["stage"]) == (200, "withdrawn")


def test_a_different_response_to_an_answered_query_is_refused(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    body = {"query_id": session.state["query"]["id"], "response": "left"}
    session.call("responses", body)
    refusal = problem(
        session.call("responses", {**body, "response": "right"}), 409, "already-answered"
    )
    assert refusal["stage"] == "query"
    assert client.table("queries", api_token)["response"].dropna().to_list() == ["left"]


def test_a_skip_is_refused_where_none_is_offered(
    client: Api, short_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    session = client.start().to_first_query()
    while session.state["query"]["skip"] is not None:
        while session.state["stage"] == "query":
            session.respond("left")
        clock.forward(120)
        session.go_on()
    shown = session.state["query"]

    refusal = problem(session.respond("skip"), 409, "skip-not-offered")
    assert refusal["stage"] == "query"
    assert session.look()["query"]["id"] == shown["id"]
    assert "skip" not in client.table("queries", api_token)["response"].to_list()


CONSENT: tuple[str, Any] = ("consent", {"version": "whatever"})
GO_ON: tuple[str, Any] = ("continue", None)
RESPOND: tuple[str, Any] = ("responses", {"query_id": "unknown", "response": "left"})
WITHDRAW: tuple[str, Any] = ("withdraw", None)
OUT_OF_ORDER: dict[str, list[tuple[str, Any]]] = {
    "consent": [GO_ON, RESPOND],
    "instructions": [CONSENT, RESPOND],
    "familiarisation": [CONSENT, RESPOND],
    "query": [CONSENT, GO_ON],
    "break": [CONSENT, RESPOND],
    "debrief": [CONSENT, RESPOND],
    "completed": [CONSENT, GO_ON, RESPOND, WITHDRAW],
    "withdrawn": [CONSENT, GO_ON, RESPOND, WITHDRAW],
    "declined": [CONSENT, GO_ON, RESPOND, WITHDRAW],
}


@pytest.mark.parametrize("stage", OUT_OF_ORDER)
def test_a_call_out_of_order_is_refused_with_the_stage_and_changes_nothing(
    client: Api, short_study: StudyInfo, clock: Clock, stage: str
) -> None:
    session = client.start()
    session.to_stage(stage, clock.forward)
    before = session.look()

    for step, body in OUT_OF_ORDER[stage]:
        assert problem(session.call(step, body), 409, "out-of-order")["stage"] == stage
    after = session.look()
    assert (after["stage"], after["progress"]) == (stage, before["progress"])


def test_a_query_that_is_not_there_is_not_found_while_another_waits(
    client: Api, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    problem(session.call(*RESPOND), 404, "not-found")


def test_consent_to_another_text_is_refused_and_names_the_one_in_force(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start()
    in_force = session.state["consent"]["version"]
    refusal = problem(session.call("consent", {"version": "0" * 12}), 409, "stale-consent")
    assert refusal["current_version"] == in_force
    assert refusal["stage"] == "consent"
    assert session.look()["stage"] == "consent"
    assert client.table("sessions", api_token)["consent_version"].isna().all()


def test_only_an_experimenter_starts_a_simulated_session(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    path, body = "/api/v1/studies/short/sessions", {"mode": "simulated"}
    problem(client.post(path, json=body), 403, "forbidden")
    wrong = {"Authorization": "Bearer made-up"}
    problem(client.post(path, json=body, headers=wrong), 403, "forbidden")
    right = {"Authorization": f"Bearer {api_token}"}
    assert client.post(path, json=body, headers=right).status_code == 201


def test_a_study_that_is_not_open_takes_nobody_but_its_experimenter(
    client: Api, app: AppContext, short_study: StudyInfo, api_token: str
) -> None:
    path = "/api/v1/studies/short/sessions"
    repository.close_study(app, "short")
    assert "closed" in problem(client.post(path, json={}), 409, "study-not-open")["detail"]
    preview = {"mode": "preview"}
    problem(client.post(path, json=preview), 403, "forbidden")
    own = {"Authorization": f"Bearer {api_token}"}
    problem(client.post(path, json={}, headers=own), 409, "study-not-open")
    assert client.post(path, json=preview, headers=own).status_code == 201


def test_a_session_under_way_may_finish_after_its_study_was_closed(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()
    repository.close_study(app, "short")
    session.to_the_end(lambda _: "left", clock.forward)
    assert session.state["stage"] == "completed"


WRONG_STARTS: list[Any] = [
    {"mode": "dream"},
    {"external_id": {"PROLIFIC_PID": "a"}},
    {"external_ids": {"": "a"}},
    {"external_ids": {"k" * 61: "a"}},
    {"external_ids": {"PROLIFIC_PID": "a" * 201}},
    {"external_ids": {f"k{n}": "a" for n in range(21)}},
    {"external_ids": {"PROLIFIC_PID": 7}},
    {"language": 7},
    [],
    None,
]


def test_a_start_that_is_not_understood_is_refused(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    for body in WRONG_STARTS:
        refusal = client.post("/api/v1/studies/short/sessions", json=body)
        assert problem(refusal, 422, "invalid")["errors"][0]["pointer"].startswith("body")
    assert client.table("sessions", api_token).empty


WRONG_RESPONSES: list[dict[str, Any]] = [
    {"response": "both"},
    {"response": None},
    {"query_id": 7},
    {"query_id": ""},
    {"rt_ms": -1},
    {"rt_ms": "soon"},
    {"rt_ms": "700"},
    {"rt_ms": False},
    {"replays": 1.5},
    {"replays": -1},
    {"events": [{"event": "playing", "side": "top", "time_ms": 1}]},
    {"events": [{"event": "playing", "side": None}]},
    {"events": [{"event": "playing", "time_ms": 1, "more": 2}]},
    {"events_left_out": -1},
]


def test_a_response_that_is_not_understood_is_refused(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    shown = session.state
    for change in WRONG_RESPONSES:
        body = {"query_id": shown["query"]["id"], "response": "left", **change}
        problem(session.call("responses", body), 422, "invalid")
    assert session.look()["progress"] == shown["progress"]


WRONG_BYTES = [
    b"{",
    b"\xff\xfe",
    b'{"query_id": "q", "response": "left", "rt_ms": NaN}',
    b'{"query_id": "q", "response": "left", "rt_ms": 1e999}',
    b'{"query_id": "\\ud800", "response": "left"}',
    b"[" * 100_000,
    b"1" * 5_000,
]


def test_bytes_that_are_no_response_are_refused(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    for content in WRONG_BYTES:
        refusal = client.post(
            "/api/v1/session/responses",
            content=content,
            headers={**session.headers, "Content-Type": "application/json"},
        )
        assert refusal.headers["content-type"] == "application/problem+json"
        assert 400 <= refusal.status_code < 500
    assert session.look()["stage"] == "query"


def test_a_key_that_no_text_can_hold_is_refused(client: Api, short_study: StudyInfo) -> None:
    content = b'{"external_ids": {"\\ud800": "a"}}'
    refusal = client.post(
        "/api/v1/studies/short/sessions",
        content=content,
        headers={"Content-Type": "application/json"},
    )
    problem(refusal, 422, "invalid")


def test_exports_are_an_experimenters_alone(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock
) -> None:
    session = client.start()
    for path in ("export/queries.csv", "export/identities.csv", "export.zip"):
        address = f"/api/v1/studies/short/{path}"
        problem(client.get(address), 401, "unauthenticated")
        problem(client.get(address, headers=session.headers), 401, "unauthenticated")
    own = {"Authorization": f"Bearer {api_token}"}
    unknown = client.get("/api/v1/studies/short/export/answers.csv", headers=own)
    assert "queries" in problem(unknown, 404, "not-found")["detail"]
    problem(client.get("/api/v1/studies/nowhere/export.zip", headers=own), 404, "not-found")
    wrong = client.get("/api/v1/studies/short/export.zip?mode=dream", headers=own)
    problem(wrong, 422, "invalid")
    clock.forward(366 * 24 * 3600)
    late = client.get("/api/v1/studies/short/export.zip", headers=own)
    problem(late, 401, "unauthenticated")


def test_every_refusal_is_described_in_the_document(application: FastAPI) -> None:
    paths = application.openapi()["paths"]
    for path in ("consent", "continue", "responses", "withdraw"):
        answers = paths[f"/api/v1/session/{path}"]["post"]["responses"]
        assert {"200", "401", "409"} <= set(answers)
        assert "application/problem+json" in answers["409"]["content"]


def test_text_that_a_database_cannot_hold_is_refused_not_a_fault_of_ours(
    client: Api, short_study: StudyInfo
) -> None:
    # SQLite would hold a NUL, PostgreSQL does not.
    answer = client.post(
        "/api/v1/studies/short/sessions", json={"external_ids": {"note": "a\x00b"}}
    )
    assert answer.status_code == 422, answer.text
    for path in ("/s/sh%00rt", "/media/%00.mp4", "/api/v1/studies/%00/export.zip"):
        assert client.get(path).status_code == 404


def test_programs_are_turned_away_at_the_door_as_from_within(client: Api) -> None:
    problem(client.get("/api/v1/studies/%00/export.zip"), 404, "not-found")
    elsewhere = {"Sec-Fetch-Site": "cross-site"}
    refusal = client.post("/api/v1/studies/short/sessions", json={}, headers=elsewhere)
    problem(refusal, 403, "forbidden")


@pytest.mark.sqlite
def test_where_the_disk_is_full_nothing_is_stored_and_the_answer_says_to_try_again(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    answer = {"query_id": session.state["query"]["id"], "response": "left"}

    def fill(connection: Any, _record: Any) -> None:
        connection.execute("PRAGMA max_page_count = 1")

    event.listen(app.database.engine, "connect", fill)
    app.database.engine.dispose()
    # More than fits into the room that is left in pages that are there.
    seen = {"event": "play", "side": "left", "value": "x" * 200}
    watched = [{**seen, "time_ms": ms} for ms in range(60)]
    refused = session.call("responses", {**answer, "events": watched})
    assert refused.status_code == 503, refused.text
    assert refused.json()["type"].endswith(":unavailable")

    event.remove(app.database.engine, "connect", fill)
    app.database.engine.dispose()
    assert session.call("responses", answer).status_code == 200
    assert session.state["progress"]["query"] == 2
