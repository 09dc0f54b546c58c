"""Several at once: two tabs, a double click, a retry, a whole class that arrives together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import TypeVar

import httpx
from fastapi import FastAPI

from app.services.studies.repository import StudyInfo

from .client import Api, Session

T = TypeVar("T")


def at_once(application: FastAPI, calls: Sequence[Callable[[Api], T]]) -> list[T]:
    """Each call from a thread and a client of its own, all let go at the same moment."""
    barrier = Barrier(len(calls))

    def run(call: Callable[[Api], T]) -> T:
        with Api(application) as api:
            barrier.wait(timeout=30)
            return call(api)

    with ThreadPoolExecutor(len(calls)) as threads:
        return list(threads.map(run, calls))


def respond(session: Session, response: str) -> Callable[[Api], httpx.Response]:
    body = {"query_id": session.state["query"]["id"], "response": response}
    return lambda api: api.post("/api/v1/session/responses", json=body, headers=session.headers)


def test_the_same_response_from_six_tabs_is_stored_once(
    application: FastAPI, client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    for answered in (1, 2, 3):
        answers = at_once(application, [respond(session, "left")] * 6)
        assert [answer.status_code for answer in answers] == [200] * 6
        assert len({answer.json()["query"]["id"] for answer in answers}) == 1
        session.look()
        assert session.state["progress"]["query"] == answered + 1

    queries = client.table("queries", api_token)
    assert queries["response"].fillna("").to_list() == ["left", "left", "left", ""]
    assert len(client.table("preferences", api_token)) == 3
    assert len(client.table("acquired", api_token)) == 3


def test_of_two_different_responses_at_once_one_is_taken(
    application: FastAPI, client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    for _ in range(3):
        pair = [respond(session, "left"), respond(session, "right")]
        answers = at_once(application, pair * 2)
        codes = [answer.status_code for answer in answers]
        assert codes in ([200, 409] * 2, [409, 200] * 2)
        refused = next(answer for answer in answers if answer.status_code == 409)
        assert refused.json()["type"] == "urn:pbpo-studio:problem:already-answered"
        session.look()
    assert client.table("queries", api_token)["response"].notna().sum() == 3


def test_leaving_a_page_twice_at_once_leaves_it_once(
    application: FastAPI, client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start()
    session.to_stage("familiarisation", lambda _: None)
    answers = at_once(
        application,
        [lambda api: api.post("/api/v1/session/continue", headers=session.headers)] * 4,
    )
    assert Counter(answer.status_code for answer in answers) == {200: 1, 409: 3}
    assert session.look()["progress"]["query"] == 1
    assert len(client.table("queries", api_token)) == 1


def test_people_who_arrive_together_are_spread_evenly_over_the_orders(
    application: FastAPI, client: Api, short_study: StudyInfo, api_token: str
) -> None:
    def start(api: Api) -> int:
        return api.post("/api/v1/studies/short/sessions", json={}).status_code

    assert at_once(application, [start] * 12) == [201] * 12
    sessions = client.table("sessions", api_token)
    assert Counter(sessions["order_index"]) == dict.fromkeys(range(6), 2)
    assert sessions["session_id"].is_unique
    assert sessions["participant_id"].is_unique
