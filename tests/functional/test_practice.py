"""Practice pairs: answered like any other, kept apart, and never learnt from."""

from __future__ import annotations

import pytest

from app.services.context import AppContext
from app.services.sessions.replay import replay
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api, by_turns

PRACTISING_PLAN = SHORT_PLAN + "\npractice: {queries: 3}\n"


@pytest.fixture
def practising_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, PRACTISING_PLAN)
    return repository.find(app, "short")


def test_practice_is_asked_first_and_looks_like_any_query(
    client: Api, practising_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_stage("practice", clock.forward)
    assert session.state["progress"] == {"trial": 0, "trials": 3, "query": 1, "queries": 3}
    shown = []
    for _ in range(3):
        query = session.state["query"]
        assert query["practice"] is True
        assert session.look()["query"] == query
        assert len(query["prefetch"]) == 2
        shown.append(query)
        session.respond("right")
    assert session.state["stage"] == "query"
    first = session.state["query"]
    assert "practice" not in first
    assert first["skip"] == shown[0]["skip"]
    # What was fetched ahead is what came.
    for query, following in zip(shown, [*shown[1:], first], strict=True):
        urls = {following["left"]["url"], following["right"]["url"]}
        assert urls == set(query["prefetch"])


def test_practice_is_exported_apart_and_teaches_nothing(
    client: Api, app: AppContext, practising_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    session = client.start()
    session.to_the_end(by_turns("left", "skip", "right"), clock.forward)
    queries = client.table("queries", api_token)
    practice = queries[queries["trial_index"] == -1]
    assert practice["trial_type"].to_list() == ["practice"] * 3
    assert practice["condition"].unique().tolist() == ["practice"]
    assert practice["response"].notna().all()
    assert len(queries) == 3 + 3 * 4
    assert (client.table("preferences", api_token)["trial_index"] >= 0).all()
    assert (client.table("acquired", api_token)["trial_index"] >= 0).all()
    assert client.table("sessions", api_token)["trials_finished"].to_list() == [3]
    replayed = list(replay(app, "short"))
    assert [trial.trial_index for trial in replayed] == [0, 1, 2]
    assert all(not trial.differences for trial in replayed)


def test_a_practice_answer_sent_twice_is_taken_once_and_another_is_refused(
    client: Api, practising_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_stage("practice", clock.forward)
    body = {"query_id": session.state["query"]["id"], "response": "left"}
    for _ in range(2):
        assert session.call("responses", body).status_code == 200
        assert session.state["progress"]["query"] == 2
    assert session.call("responses", {**body, "response": "right"}).status_code == 409
    assert session.go_on().json()["stage"] == "practice"


def test_a_practice_video_that_does_not_play_is_replaced(
    client: Api, practising_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    session = client.start().to_stage("practice", clock.forward)
    before = session.state["query"]["id"]
    assert session.call("faults", {"query_id": before}).status_code == 200
    assert session.state["stage"] == "practice"
    assert session.state["query"]["id"] != before
    session.respond("left")
    assert session.state["progress"]["query"] == 2


def test_the_page_says_that_practice_does_not_count(
    client: Api, practising_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_stage("practice", clock.forward)
    client.cookies.set("pbpo_session_short", session.token)
    page = client.get("/s/short").text
    assert "Practice · Pair 1 of 3" in page
    assert "Does not count yet" in page
    while session.state["stage"] == "practice":
        session.respond("left")
    assert "From here on it counts" in client.get("/s/short").text
    session.respond("left")
    assert "From here on it counts" not in client.get("/s/short").text
