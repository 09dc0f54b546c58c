"""The page Machines and the operator's desk, as an experimenter uses them."""

from __future__ import annotations

import re

import pytest
from sqlalchemy import select

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.rollouts import machines
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.records import AuditEvent
from app.storage.models.rollouts import Rollout
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api
from .desk import Desk
from .machine_study import ROBOT_PLAN, Robot, add_candidates, ask, video_bytes

URL = "/studies/robot"


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ROBOT_PLAN)
    return repository.find(app, "robot")


@pytest.fixture
def candidates(app: AppContext, study: StudyInfo) -> list[int]:
    return add_candidates(app, study.slug)


@pytest.fixture
def admin(client: Api, app: AppContext, study: StudyInfo) -> Desk:
    return Desk(client, app, "lab@example.org", accounts.Role.ADMIN)


def row(app: AppContext, public_id: str) -> Rollout:
    with app.database.read() as db:
        return db.scalars(select(Rollout).where(Rollout.public_id == public_id)).one()


def hand_in(admin: Desk, rollout: str, attempt: int, video: bytes) -> int:
    admin._be()
    return admin.client.post(
        f"{URL}/desk/{rollout}/recording",
        data={"csrf_token": admin.csrf, "attempt": str(attempt)},
        files={"video": ("run.mp4", video)},
    ).status_code


def test_a_machine_is_added_with_a_command_that_is_shown_once(
    admin: Desk, client: Api, app: AppContext, candidates: list[int]
) -> None:
    page = admin.post(f"{URL}/machines", name="arm-1").text
    found = re.search(r"--token (\S+)", page)
    assert found is not None
    assert "--w0 {w0} --w1 {w1} --out {video}" in page
    assert found[1] not in admin.get(f"{URL}/machines").text

    ask(app, candidates[0])
    assert Robot(client, found[1]).claim().status_code == 200
    page = admin.get(f"{URL}/machines").text
    assert "Records Opening time 0 s, Closing time 0 s" in page

    admin.post(f"{URL}/machines/revoke", name="arm-1")
    assert Robot(client, found[1]).claim().status_code == 401


def test_a_name_that_cannot_be_one_is_refused_with_what_is_expected(admin: Desk) -> None:
    answer = admin.post(f"{URL}/machines", name="arm one!")
    assert answer.status_code == 409
    assert "expected" in answer.text.lower()
    assert 'data-testid="machine-command"' not in answer.text


def test_the_emergency_stop_holds_until_it_is_released_and_says_who_pressed_it(
    admin: Desk, client: Api, app: AppContext, candidates: list[int]
) -> None:
    robot = Robot(client, machines.add(app, "robot", "arm"))
    ask(app, candidates[0])
    admin.post(f"{URL}/machines/stop")
    assert "All machines are stopped" in admin.get(f"{URL}/machines").text
    assert robot.claim().status_code == 204

    admin.post(f"{URL}/machines/release")
    assert robot.claim().status_code == 200
    with app.database.read() as db:
        trail = {
            event.action: event.actor
            for event in db.scalars(select(AuditEvent))
            if event.action.startswith("machines ")
        }
    assert trail == {"machines stopped": "lab@example.org", "machines released": "lab@example.org"}


def test_machines_that_take_longer_than_a_viewing_are_named_with_a_remedy(
    admin: Desk, client: Api, app: AppContext, candidates: list[int], clock: Clock
) -> None:
    robot = Robot(client, machines.add(app, "robot", "arm"))
    asked = ask(app, candidates[0])
    robot.claimed()
    assert 'data-testid="slow"' not in admin.get(f"{URL}/machines").text
    clock.forward(50)
    assert robot.put(asked, video_bytes(), attempt=1).status_code == 201
    said = "the last rollouts took 50 s each: people wait for every pair; set lag"
    assert said in admin.get(f"{URL}/machines").text


def test_a_rollout_is_cancelled_asked_again_and_withdrawn_by_buttons(
    admin: Desk, client: Api, app: AppContext, candidates: list[int]
) -> None:
    rollout = ask(app, candidates[0])
    assert admin.post(f"{URL}/rollouts/{rollout}/cancel").status_code == 303
    assert row(app, rollout).status == "cancelled"
    assert admin.post(f"{URL}/rollouts/{rollout}/cancel").status_code == 409
    assert admin.post(f"{URL}/rollouts/{rollout}/retry").status_code == 303
    assert row(app, rollout).status == "asked"

    robot = Robot(client, machines.add(app, "robot", "arm"))
    robot.claimed()
    assert robot.put(rollout, video_bytes()).status_code == 201
    assert admin.post(f"{URL}/rollouts/{rollout}/withdraw", reason="").status_code == 409
    assert admin.post(f"{URL}/rollouts/{rollout}/withdraw", reason="blurred").status_code == 303
    assert row(app, rollout).status == "withdrawn"
    assert "Withdrawn: blurred" in admin.get(f"{URL}/machines").text


def test_at_the_desk_a_person_records_what_a_machine_would(
    admin: Desk, client: Api, app: AppContext, candidates: list[int]
) -> None:
    rollout = ask(app, candidates[13])
    assert "1 recording is waiting" in admin.get(f"{URL}/desk").text
    admin.post(f"{URL}/desk/take")
    page = admin.get(f"{URL}/desk").text
    assert "<dt>Opening time, s</dt><dd>0.1</dd>" in page
    assert "<dt>Closing time, s</dt><dd>3</dd>" in page
    # What the desk has, no machine is given.
    assert Robot(client, machines.add(app, "robot", "arm")).claim().status_code == 204

    assert hand_in(admin, rollout, 1, video_bytes()) == 303
    recorded = row(app, rollout)
    assert (recorded.status, recorded.recording_id is not None) == ("recorded", True)


def test_what_is_no_video_is_refused_at_the_desk(
    admin: Desk, app: AppContext, candidates: list[int]
) -> None:
    rollout = ask(app, candidates[0])
    admin.post(f"{URL}/desk/take")
    assert hand_in(admin, rollout, 1, b"not a video") == 409
    assert row(app, rollout).recording_id is None
    assert hand_in(admin, rollout, 1, b"") in (400, 409)


@pytest.mark.parametrize(
    ("what", "status", "attempts"), [("unsafe", "unsafe", 0), ("back", "asked", 0)]
)
def test_at_the_desk_a_run_is_called_unsafe_or_left_to_others(
    admin: Desk, app: AppContext, candidates: list[int], what: str, status: str, attempts: int
) -> None:
    rollout = ask(app, candidates[0])
    admin.post(f"{URL}/desk/take")
    admin.post(f"{URL}/desk/{rollout}/report", what=what, reason="it shakes")
    after = row(app, rollout)
    assert after.status == status
    assert len(after.failures) == attempts


def test_a_study_without_machines_has_no_such_tab(
    client: Api, app: AppContext, study_shelf: StudyShelf
) -> None:
    study_shelf.put_into(app, SHORT_PLAN)
    somebody = Desk(client, app, "lab@example.org", accounts.Role.ADMIN)
    assert ">Machines</a>" not in somebody.get("/studies/short").text


def test_a_study_with_machines_has_their_tab(admin: Desk) -> None:
    assert ">Machines</a>" in admin.get(URL).text
