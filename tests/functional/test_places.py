"""Places: who holds one, and what happens to those who come when none is left, or too late."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from sqlalchemy import text

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.web.http.concurrency import WRITING
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api, Session
from .served import Served
from .test_participant_pages import COOKIE, agree, heading, sent_on
from .test_recruitment import BACK_TO_PROLIFIC, return_link
from .workers import until

PLACES_PLAN = SHORT_PLAN + "\nplaces: 2\nlease_minutes: 30\n"
Request = pytest.FixtureRequest
FULL = "No place left"
CONSENT = "Before you take part"
AWAY = "You were away for too long"


@pytest.fixture
def small_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, PLACES_PLAN)
    return repository.find(app, "short")


def left_behind(client: Api, shelf: StudyShelf, app: AppContext, policy: str) -> Session:
    """A session at a query, in the browser, in a study with this policy and an age of 2 hours."""
    rule = f"\nresume: {{policy: {policy}, max_age_hours: 2}}\n"
    shelf.put_into(app, SHORT_PLAN + rule)
    session = client.start().to_first_query()
    client.cookies.set(COOKIE, session.token)
    return session


def test_nobody_is_let_in_when_active_sessions_fill_the_places(
    client: Api, small_study: StudyInfo, api_token: str
) -> None:
    inside = [client.start() for _ in range(2)]
    refusal = client.post("/api/v1/studies/short/sessions", json={})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:study-full"
    page = client.get("/s/short")
    assert (page.status_code, heading(page)) == (409, FULL)
    assert "you can try again in an hour or two" in page.text
    # Those inside go on, and a look at the study needs no place.
    assert inside[0].consent().status_code == 200
    assert client.start(mode="preview", by=api_token).state["stage"] == "consent"


def test_whoever_comes_from_a_platform_and_finds_no_place_gets_its_code(
    client: Api, app: AppContext, study_shelf: StudyShelf
) -> None:
    said = "recruitment: {platform: prolific, codes: {completed: C1, screened_out: FULL2}}\n"
    study_shelf.put_into(app, PLACES_PLAN.replace("places: 2", "places: 1") + said)
    client.start()
    page = client.get("/s/short?PROLIFIC_PID=5f0c")
    assert (page.status_code, heading(page)) == (409, FULL)
    assert return_link(page.text) == f"{BACK_TO_PROLIFIC}FULL2"
    assert "try again" not in page.text


def test_a_place_is_free_again_once_its_holder_leaves_or_is_not_heard_of(
    client: Api, small_study: StudyInfo, clock: Clock
) -> None:
    leaves = client.start().to_first_query()
    client.start()
    leaves.call("withdraw")
    client.start()
    assert client.post("/api/v1/studies/short/sessions", json={}).status_code == 409
    clock.forward(30 * 60 + 1)
    assert heading(client.get("/s/short")) == CONSENT
    assert client.start().state["stage"] == "consent"


def test_whoever_completed_holds_a_place_for_good(
    client: Api, small_study: StudyInfo, clock: Clock
) -> None:
    for _ in range(2):
        client.start().to_stage("completed", clock.forward)
        clock.forward(24 * 3600)
    assert client.post("/api/v1/studies/short/sessions", json={}).status_code == 409


def test_the_last_place_taken_meanwhile_shows_that_none_is_left(
    client: Api, small_study: StudyInfo
) -> None:
    client.start()
    page = client.get("/s/short")
    client.start()
    assert heading(page) == CONSENT
    given = {"version": page.text.split('name="version" value="')[1].split('"')[0]}
    sent_on(client.post("/s/short/consent", data=given))
    assert heading(client.get("/s/short")) == FULL


@pytest.mark.postgresql
def test_the_last_place_is_one_persons_of_all_who_ask_two_servers_for_it_at_once(
    app: AppContext, study_shelf: StudyShelf, tmp_path: Path, media_dir: Path
) -> None:
    study_shelf.put_into(app, PLACES_PLAN.replace("places: 2", "places: 1"))
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
    with (
        Served("serve", tmp_path / "one" / "data", media_dir) as one,
        Served("serve", tmp_path / "other" / "data", media_dir) as other,
        ThreadPoolExecutor(2 * WRITING) as people,
    ):
        with app.database.write() as held:
            # Each who looked for a place before the others wrote has to wait here before they do.
            held.execute(text("LOCK TABLE participants IN EXCLUSIVE MODE"))
            asking = [
                people.submit(httpx.post, f"{url}/api/v1/studies/short/sessions", json={})
                for url in WRITING * (one.url, other.url)
            ]
            until(lambda: waiting(app) == len(asking), "all of them wait")
        statuses = sorted(answer.result().status_code for answer in asking)
    assert statuses == [201] + [409] * (len(asking) - 1)


def waiting(app: AppContext) -> int:
    """How many wait for somebody else's lock in the studio's database."""
    blocked = "datname = current_database() AND wait_event_type = 'Lock'"
    with app.database.read() as db:
        found = db.scalar(text(f"SELECT count(*) FROM pg_stat_activity WHERE {blocked}"))
    return int(found)


@pytest.mark.parametrize("policy", ["resume", "restart", "block"])
def test_within_the_age_everybody_goes_on_where_they_were(
    client: Api, app: AppContext, study_shelf: StudyShelf, clock: Clock, policy: str
) -> None:
    session = left_behind(client, study_shelf, app, policy)
    clock.forward(2 * 3600 - 1)
    assert heading(client.get("/s/short")) == "Which video is better?"
    assert session.respond("left").status_code == 200
    # Each action begins the time anew.
    clock.forward(2 * 3600 - 1)
    assert session.respond("left").status_code == 200


def test_after_too_long_a_session_cannot_be_resumed_and_another_may_begin(
    client: Api, app: AppContext, study_shelf: StudyShelf, clock: Clock
) -> None:
    session = left_behind(client, study_shelf, app, "resume")
    clock.forward(2 * 3600)
    refusal = session.respond("left")
    assert refusal.status_code == 401
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:session-expired"
    page = client.get("/s/short")
    assert heading(page) == AWAY
    assert "open the study again" in page.text
    assert f'{COOKIE}=""' in page.headers["set-cookie"]
    client.cookies.clear()
    assert heading(client.get("/s/short")) == CONSENT


def test_after_too_long_a_study_may_begin_anew_with_the_same_participant(
    client: Api,
    app: AppContext,
    study_shelf: StudyShelf,
    clock: Clock,
    request: Request,
) -> None:
    left_behind(client, study_shelf, app, "restart")
    clock.forward(2 * 3600)
    assert heading(client.get("/s/short")) == CONSENT
    sent_on(agree(client))
    sessions = client.table("sessions", request.getfixturevalue("api_token"))
    assert sessions["stage"].to_list() == ["query", "instructions"]
    assert sessions["participant_id"].nunique() == 1


def test_after_too_long_a_study_may_let_nobody_in_again(
    client: Api,
    app: AppContext,
    study_shelf: StudyShelf,
    clock: Clock,
    request: Request,
) -> None:
    left_behind(client, study_shelf, app, "block")
    clock.forward(2 * 3600)
    for _ in range(2):
        page = client.get("/s/short")
        assert (page.status_code, heading(page)) == (409, AWAY)
        assert "open the study again" not in page.text
    sent_on(client.post("/s/short/consent", data={"version": "0" * 12}))
    assert len(client.table("sessions", request.getfixturevalue("api_token"))) == 1


@pytest.mark.parametrize(
    ("policy", "status", "sessions"), [("resume", 201, 2), ("restart", 201, 2), ("block", 401, 1)]
)
def test_a_platforms_id_is_treated_as_the_browser_is(
    client: Api,
    app: AppContext,
    study_shelf: StudyShelf,
    clock: Clock,
    request: Request,
    policy: str,
    status: int,
    sessions: int,
) -> None:
    rule = f"\nresume: {{policy: {policy}, max_age_hours: 2}}\n"
    rule += "recruitment: {platform: prolific, codes: {completed: C1}}\n"
    study_shelf.put_into(app, SHORT_PLAN + rule)
    came = {"external_ids": {"PROLIFIC_PID": "abc"}}
    client.start(external_ids={"PROLIFIC_PID": "abc"}).to_first_query()
    clock.forward(2 * 3600)
    assert client.post("/api/v1/studies/short/sessions", json=came).status_code == status
    rows = client.table("sessions", request.getfixturevalue("api_token"))
    assert len(rows) == sessions
    # An id alone joins nobody.
    assert rows["participant_id"].nunique() == sessions
