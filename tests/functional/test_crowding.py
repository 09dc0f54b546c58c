"""Sessions that are begun and not gone on with: how many may be, and what becomes of them."""

from __future__ import annotations

import pytest
from sqlalchemy import func, select

from app.services.arrival import entry_links
from app.services.context import AppContext
from app.services.maintenance import abandoned_sessions, periodic_tasks
from app.services.studies.repository import StudyInfo
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import Identity, Participant, SessionRow
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .test_participant_pages import heading, version

SESSIONS = "/api/v1/studies/short/sessions"
HOUR = 3600.0
DAY = 24 * HOUR
CROWDED = "Too many people at once"
CONSENT = "Before you take part"


@pytest.fixture(autouse=True)
def _room_for_three(app: AppContext) -> None:
    # Settings do not change once read; a test's studio may have others.
    settings = app.settings.model_copy(update={"begun_per_hour": 3})
    object.__setattr__(app, "settings", settings)


def rows(app: AppContext, table: type) -> int:
    with app.database.read() as db:
        return db.scalar(select(func.count()).select_from(table)) or 0


def test_a_stranger_who_begins_sessions_and_leaves_them_is_told_when_to_come_back(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    client.start()
    clock.forward(600)
    client.start()
    client.start()
    refusal = client.post(SESSIONS, json={})
    assert refusal.status_code == 429
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:too-many-begun"
    assert refusal.headers["Retry-After"] == str(3000)
    clock.forward(3000)
    assert client.start().state["stage"] == "consent"


def test_people_who_answer_make_no_crowd_however_many_come(
    client: Api, short_study: StudyInfo
) -> None:
    for _ in range(7):
        client.start().to_first_query().respond("left")
    assert heading(client.get("/s/short")) == CONSENT


@pytest.mark.parametrize("doing", ["consent", "decline", "delete"])
def test_no_other_call_makes_room_for_more(client: Api, short_study: StudyInfo, doing: str) -> None:
    for _ in range(3):
        session = client.start()
        if doing == "consent":
            session.to_first_query()
        else:
            assert session.call("withdraw", {"delete": doing == "delete"}).status_code == 200
    assert client.post(SESSIONS, json={}).status_code == 429


def test_who_deletes_what_they_began_keeps_newcomers_out_until_the_day_is_over(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    for _ in range(3):
        assert client.start().call("withdraw", {"delete": True}).status_code == 200
    refusal = client.get("/s/short")
    assert (refusal.status_code, heading(refusal)) == (429, CROWDED)
    # Tests begin at 9 o'clock.
    assert refusal.headers["Retry-After"] == str(15 * 3600)
    assert "again in 15 hours" in refusal.text
    clock.forward(15 * HOUR)
    assert client.start().state["stage"] == "consent"


def test_a_newcomer_gets_a_page_that_says_when_to_come_back_and_those_inside_go_on(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    page = client.get("/s/short")
    inside = [client.start() for _ in range(3)]
    crowded = client.get("/s/short")
    assert (crowded.status_code, heading(crowded)) == (429, CROWDED)
    assert "again in 60 minutes" in crowded.text
    assert crowded.headers["Retry-After"] == "3600"
    # Whoever has read the consent meanwhile is told the same.
    agreed = client.post("/s/short/consent", data={"version": version(page)})
    assert (agreed.status_code, agreed.headers["location"]) == (303, "/s/short")
    assert rows(app, SessionRow) == 3
    assert inside[0].consent().status_code == 200


def test_an_experimenter_begins_as_many_as_they_like(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    headers = {"Authorization": f"Bearer {api_token}"}
    for _ in range(4):
        answer = client.post(SESSIONS, json={"mode": "simulated"}, headers=headers)
        assert answer.status_code == 201


def test_single_use_links_are_their_own_bound(
    client: Api, app: AppContext, recruit: Recruit
) -> None:
    recruit("recruitment: {links: single-use}\n")
    for path in entry_links.create(app, "short", 4):
        client.start(entry=path.rpartition("=")[2])
    assert rows(app, SessionRow) == 4


PROLIFIC = "recruitment: {platform: prolific, codes: {completed: C1}}\n"


def test_a_flood_at_the_open_door_keeps_out_nobody_whom_a_platform_sends(
    client: Api, app: AppContext, recruit: Recruit
) -> None:
    recruit(PROLIFIC)
    for _ in range(3):
        client.start()
    assert client.post(SESSIONS, json={}).status_code == 429
    # What is no id of the platform's opens no door.
    assert client.post(SESSIONS, json={"external_ids": {"STUDY_ID": "s"}}).status_code == 429
    assert heading(client.get("/s/short?STUDY_ID=s")) == CROWDED
    link = "/s/short?PROLIFIC_PID=5f0c"
    page = client.get(link)
    assert heading(page) == CONSENT
    path = "/s/short/consent?PROLIFIC_PID=5f0c"
    agreed = client.post(path, data={"version": version(page)})
    assert (agreed.status_code, agreed.headers["location"]) == (303, "/s/short")
    assert rows(app, SessionRow) == 4


def test_a_flood_of_made_up_ids_ends_as_well(
    client: Api, app: AppContext, recruit: Recruit
) -> None:
    recruit(PROLIFIC)
    for number in range(6):
        client.start(external_ids={"PROLIFIC_PID": f"5f{number}"})
    body = {"external_ids": {"PROLIFIC_PID": "5f9"}}
    assert client.post(SESSIONS, json=body).status_code == 429
    assert heading(client.get("/s/short?PROLIFIC_PID=5f9")) == CROWDED


def test_sessions_that_never_came_to_consent_are_gone_after_a_day(
    client: Api, app: AppContext, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    left = client.start(external_ids={"PROLIFIC_PID": "5f0c"})
    agreed = client.start()
    agreed.consent()
    clock.forward(DAY - 1)
    client.start()
    assert abandoned_sessions.count(app) == 0
    clock.forward(1)
    assert abandoned_sessions.count(app) == 1
    periodic_tasks.run_all(app)
    assert (rows(app, SessionRow), rows(app, Participant)) == (2, 2)
    assert (rows(app, Identity), rows(app, Tombstone)) == (0, 0)
    answer = client.get("/api/v1/session", headers=left.headers)
    assert answer.status_code == 401
    assert agreed.look()["stage"] != "consent"


def test_a_person_with_another_session_stays(
    client: Api, app: AppContext, recruit: Recruit, clock: Clock
) -> None:
    recruit("recruitment: {platform: prolific, codes: {completed: C1}, returning: again}\n")
    person = {"PROLIFIC_PID": "5f0c"}
    client.start(external_ids=person).to_stage("withdrawn", clock.forward)
    client.start(external_ids=person)
    clock.forward(DAY)
    assert abandoned_sessions.delete_abandoned(app) == 1
    assert (rows(app, SessionRow), rows(app, Participant)) == (1, 1)
    assert rows(app, Identity) == 1


def test_a_sweep_goes_by_batches_and_can_be_stopped(
    client: Api,
    app: AppContext,
    short_study: StudyInfo,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(abandoned_sessions, "_AT_ONCE", 2)
    for _ in range(3):
        client.start()
    clock.forward(DAY)
    asked = iter([False, True])
    assert abandoned_sessions.delete_abandoned(app, lambda: next(asked)) == 2
    assert abandoned_sessions.delete_abandoned(app) == 1
