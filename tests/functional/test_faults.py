"""A video that did not play: the query is set aside, kept apart, and another takes its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.sessions import replay as replaying
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api, Session, by_turns
from .own_study import write_own_study


def report(session: Session, **more: object) -> int:
    body = {"query_id": session.state["query"]["id"], **more}
    return session.call("faults", body).status_code


def urls(session: Session) -> list[str]:
    return [session.state["query"][side]["url"] for side in ("left", "right")]


@pytest.fixture
def own_study(app: AppContext, tmp_path: Path) -> None:
    """Three candidates; only the first of them has two recordings."""
    repository.create(app, repository.load_folder(str(write_own_study(tmp_path / "kettles"))))
    repository.open_study(app, "kettles")


def test_another_query_takes_the_place_of_one_that_did_not_play(
    client: Api, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    session.respond("left")
    before, shown = session.state, urls(session)
    assert report(session, reason="left: failed") == 200
    assert session.state["progress"] == before["progress"]
    assert session.state["query"]["id"] != before["query"]["id"]
    assert set(urls(session)).isdisjoint(shown)
    assert session.look()["query"]["id"] == session.state["query"]["id"]


def test_the_same_candidates_are_shown_by_other_recordings(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    for reason in ("left: failed", "=right: stalled"):
        assert report(session, reason=reason) == 200
    session.respond("right")

    queries, faults = client.table("queries", api_token), client.table("faults", api_token)
    assert faults["attempt"].to_list() == [0, 1]
    assert faults["fault"].to_list() == ["left: failed", "'=right: stalled"]
    assert faults["set_aside_at"].to_list() == ["2026-03-01T09:00:00.000Z"] * 2
    answered = queries.iloc[0]
    for side in ("left", "right"):
        assert set(faults[f"{side}_candidate"]) == {answered[f"{side}_candidate"]}
        recordings = [*faults[f"{side}_recording"], answered[f"{side}_recording"]]
        assert len(set(recordings)) == 3
    assert (answered["response"], answered["trial_type"]) == ("right", "random")


def test_where_there_is_no_other_recording_other_candidates_are_shown(
    client: Api, own_study: None, api_token: str
) -> None:
    session = client.start("kettles").to_first_query()
    for _ in range(6):
        assert report(session) == 200
    response = client.get(
        "/api/v1/studies/kettles/export/faults.csv",
        headers={"Authorization": f"Bearer {api_token}"},
    )
    assert response.text.count("\n") == 7
    assert session.respond("left").status_code == 200


def test_what_is_set_aside_is_in_no_other_table_and_teaches_nothing(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock, app: AppContext
) -> None:
    session = client.start().to_first_query()
    choose, reported = by_turns("skip", "left", "right"), 0
    while session.state["stage"] != "completed":
        if session.state["stage"] == "query" and session.state["progress"]["query"] in (2, 4):
            assert report(session) == 200
            reported += 1
        assert session.step(
            choose(session.state) if "query" in session.state else "", clock.forward
        )

    queries = client.table("queries", api_token)
    assert reported == 6 == len(client.table("faults", api_token))
    assert len(queries) == len(client.table("acquired", api_token)) == 12
    assert queries["response"].notna().all()
    assert not queries.duplicated(["trial_index", "query_index"]).any()
    preferences = client.table("preferences", api_token)
    answers = preferences[preferences["origin"] == "answer"]
    assert len(answers) == (queries["response"] != "skip").sum()
    assert all(not trial.differences for trial in replaying.replay(app, "short"))


def test_the_same_report_again_changes_nothing(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    body = {"query_id": session.state["query"]["id"]}
    first, again = (session.call("faults", body).json() for _ in range(2))
    assert first["query"]["id"] == again["query"]["id"]
    assert len(client.table("faults", api_token)) == 1


def test_a_query_that_was_set_aside_takes_no_response(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    query_id = session.state["query"]["id"]
    report(session)
    refusal = session.call("responses", {"query_id": query_id, "response": "left"})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:set-aside"
    assert refusal.json()["stage"] == "query"


def test_a_query_that_was_answered_is_not_set_aside(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    query_id = session.state["query"]["id"]
    session.respond("left")
    refusal = session.call("faults", {"query_id": query_id})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:already-answered"
    assert session.call("faults", {"query_id": "another"}).status_code == 404


def test_nothing_is_asked_of_somebody_who_has_left(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    body = {"query_id": session.state["query"]["id"]}
    session.call("withdraw")
    for step, more in (("faults", {}), ("responses", {"response": "left"})):
        refusal = session.call(step, {**body, **more})
        assert (refusal.status_code, refusal.json()["stage"]) == (409, "withdrawn")
    assert client.table("faults", api_token).empty
    assert len(client.table("queries", api_token)) == 1


def test_attempts_at_one_query_come_to_an_end(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    codes = [report(session) for _ in range(21)]
    assert codes == [200] * 19 + [409] * 2
    assert session.respond("left").status_code == 200


def test_a_recording_whose_file_has_gone_is_not_shown_in_anothers_place(
    client: Api, own_study: None, app: AppContext
) -> None:
    session = client.start("kettles").to_first_query()
    files = sorted(app.settings.uploads_dir.iterdir())
    files[0].unlink()
    for _ in range(5):
        assert report(session) == 200
        assert all(client.request("HEAD", url).status_code == 200 for url in urls(session))


def test_without_any_video_it_is_said_so_and_nothing_is_set_aside(
    client: Api, own_study: None, app: AppContext
) -> None:
    session = client.start("kettles").to_first_query()
    for file in app.settings.uploads_dir.iterdir():
        file.unlink()
    refusal = session.call("faults", {"query_id": session.state["query"]["id"]})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:nothing-to-show"
    assert session.respond("left").status_code == 200


@pytest.mark.parametrize("body", [{}, {"query_id": ""}, {"query_id": "x", "reason": "y" * 201}])
def test_a_report_that_is_not_understood_is_refused(
    client: Api, short_study: StudyInfo, body: dict[str, str]
) -> None:
    assert client.start().to_first_query().call("faults", body).status_code == 422
