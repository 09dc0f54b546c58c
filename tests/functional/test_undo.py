"""Taking the last response back: nothing stays of it but the record that it was."""

from __future__ import annotations

import httpx
import pytest

from app.services.context import AppContext
from app.services.sessions import replay as replaying
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock, StudyShelf

from .client import Api, Session
from .conftest import LEARNING_PLAN

UNDO_PLAN = LEARNING_PLAN.replace("break_s: 120", "break_s: 0\norder: fixed\nquery: {undo_s: 5}")


@pytest.fixture
def session(app: AppContext, study_shelf: StudyShelf, client: Api) -> Session:
    study_shelf.put_into(app, UNDO_PLAN)
    return client.start().to_first_query()


def undo(session: Session) -> httpx.Response:
    return session.call("undo", {"query_id": session.state["query"]["undo"]["query_id"]})


def test_a_response_can_be_taken_back_for_some_seconds(session: Session, clock: Clock) -> None:
    assert "undo" not in session.state["query"]
    first = session.state
    session.respond("left")
    assert session.state["query"]["undo"] == {
        "query_id": first["query"]["id"],
        "seconds_left": 5.0,
    }
    clock.forward(4)
    assert session.look()["query"]["undo"]["seconds_left"] == 1.0
    assert undo(session).status_code == 200
    assert session.state["progress"] == first["progress"]
    for part in ("id", "left", "right"):
        assert session.state["query"][part] == first["query"][part]
    assert "undo" not in session.state["query"]


def test_what_was_taken_back_stays_in_the_record_and_teaches_nothing(
    session: Session, app: AppContext, client: Api, clock: Clock
) -> None:
    from .test_checks import table

    for response in ("left", "right", "skip"):
        session.respond(response, rt_ms=700, events=[{"event": "stall", "time_ms": 5}])
        assert undo(session).status_code == 200
        session.respond("right", rt_ms=800)
    assert session.respond("skip").status_code == 200

    queries, undone = table(app, "queries"), table(app, "undone")
    assert queries["response"].fillna("").to_list() == ["right"] * 3 + ["skip", ""]
    assert undone["response"].to_list() == ["left", "right", "skip"]
    assert undone["rt"].to_list() == [700] * 3
    assert undone["query_index"].to_list() == [0, 1, 2]
    assert table(app, "acquired")["query_index"].to_list() == [0, 1, 2, 3]
    preferences = table(app, "preferences")
    assert preferences["preference_index"].to_list() == list(range(len(preferences)))
    assert (preferences["origin"] == "answer").sum() == 3
    assert table(app, "events")["event"].to_list() == ["stall", "undone"] * 3
    assert table(app, "evidence")["stalls"].isna().all()
    assert not next(iter(replaying.replay(app, "short"))).differences


def test_the_same_undo_again_changes_nothing(session: Session) -> None:
    session.respond("left")
    body = {"query_id": session.state["query"]["undo"]["query_id"]}
    first, again = (session.call("undo", body).json() for _ in range(2))
    assert first["query"]["id"] == again["query"]["id"] == body["query_id"]


def test_too_late_is_too_late(session: Session, clock: Clock) -> None:
    session.respond("left")
    body = {"query_id": session.state["query"]["undo"]["query_id"]}
    clock.forward(8.1)
    assert "undo" not in session.look()["query"]
    refusal = session.call("undo", body)
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:too-late-to-undo"
    assert refusal.json()["stage"] == "query"


def test_a_clock_that_is_set_back_by_hours_offers_no_undo_for_hours(
    session: Session, clock: Clock
) -> None:
    session.respond("left")
    body = {"query_id": session.state["query"]["undo"]["query_id"]}
    clock.forward(-7200)
    assert "undo" not in session.look()["query"]
    # What is not offered is refused: it was taken for two hours.
    assert session.call("undo", body).status_code == 409
    clock.forward(7200)
    assert session.look()["query"]["undo"]["seconds_left"] == 5.0
    assert session.call("undo", body).status_code == 200


@pytest.mark.parametrize("set_to", [-61, -60, -30, -1, 0, 4.9, 5, 7.9, 8, 61, 86_400])
def test_whatever_the_clock_does_what_is_offered_is_done(
    session: Session, clock: Clock, set_to: float
) -> None:
    session.respond("left")
    body = {"query_id": session.state["query"]["undo"]["query_id"]}
    clock.forward(set_to)
    offered = session.look()["query"].get("undo", {"seconds_left": 0})["seconds_left"]
    assert 0 <= offered <= 5
    # A page counts from when it heard of it, so that it may ask some seconds later.
    is_in_time = -60 <= set_to < 5 + 3
    assert (offered > 0) == (-60 <= set_to < 5)
    assert session.call("undo", body).status_code == (200 if is_in_time else 409)


def test_an_answer_of_the_practice_is_not_offered_to_be_taken_back(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    study_shelf.put_into(app, UNDO_PLAN + "practice: {queries: 2}\n")
    session = client.start()
    while session.state["stage"] != "practice":
        session.consent() if session.state["stage"] == "consent" else session.go_on()
    answered = {"query_id": session.state["query"]["id"]}
    session.respond("left")
    assert session.state["stage"] == "practice"
    assert "undo" not in session.state["query"]
    assert session.call("undo", answered).status_code == 409


def test_only_the_last_response_can_be_taken_back(session: Session) -> None:
    session.respond("left")
    earlier = {"query_id": session.state["query"]["undo"]["query_id"]}
    session.respond("left")
    assert session.call("undo", earlier).status_code == 409
    open_query = {"query_id": session.state["query"]["id"]}
    assert session.call("undo", open_query).status_code == 409
    assert session.call("undo", {"query_id": "another"}).status_code == 404


def test_what_earlier_skips_had_taught_by_it_goes_with_it(
    session: Session, app: AppContext
) -> None:
    from .test_checks import table

    session.respond("skip")
    # The skip waited for a first choice: this one says what is preferred over what it showed.
    session.respond("left")
    assert (table(app, "preferences")["origin"] == "synthesis").sum() == 2
    assert undo(session).status_code == 200
    assert table(app, "preferences").empty
    session.respond("right")

    queries, preferences = table(app, "queries"), table(app, "preferences")
    assert preferences["preference_index"].to_list() == [0, 1, 2]
    chosen = queries["right_candidate"][1]
    assert preferences["winner"].to_list() == [chosen] * 3
    passed_over = queries[["left_candidate", "right_candidate"]].loc[0]
    assert set(preferences["loser"]) == {*passed_over, queries["left_candidate"][1]}


def test_nobody_goes_back_by_two_responses(session: Session, app: AppContext, client: Api) -> None:
    from .test_checks import table

    first = {"query_id": session.state["query"]["id"]}
    session.respond("left", rt_ms=1)
    session.respond("right", rt_ms=2)
    assert undo(session).status_code == 200
    assert "undo" not in session.state["query"]
    refusal = session.call("undo", first)
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:too-late-to-undo"
    # With the query that followed from it would go the record of what was taken back.
    assert table(app, "undone")["response"].to_list() == ["right"]


def test_a_response_stands_once_the_next_pair_was_set_aside(session: Session) -> None:
    session.respond("left")
    body = {"query_id": session.state["query"]["undo"]["query_id"]}
    session.call("faults", {"query_id": session.state["query"]["id"]})
    assert "undo" not in session.state["query"]
    assert session.call("undo", body).status_code == 409


def test_the_last_response_of_a_trial_stands(session: Session) -> None:
    for _ in range(5):
        last = {"query_id": session.state["query"]["id"]}
        session.respond("left")
    assert session.state["progress"]["trial"] == 2
    assert "undo" not in session.state["query"]
    assert session.call("undo", last).status_code == 409


def test_where_no_undo_is_offered_there_is_none(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    body = {"query_id": session.state["query"]["id"]}
    session.respond("left")
    assert "undo" not in session.state["query"]
    assert session.call("undo", body).status_code == 409
