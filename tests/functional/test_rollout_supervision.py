"""What experimenters see of rollouts, and do to them: warnings, withdrawal, export, commands."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from datetime import timedelta

import pandas as pd
import pytest
from sqlalchemy import select

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.rollouts import interventions, machines
from app.services.runtime.errors import ConflictError, NotFoundError
from app.services.sessions import box_withdrawal
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, QueryRow, Response
from tests.conftest import Clock, StudyShelf

from .client import Api
from .machine_study import ROBOT_PLAN, Robot, add_candidates, add_trial, ask, video_bytes


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ROBOT_PLAN)
    return repository.find(app, "robot")


@pytest.fixture
def new_robot(app: AppContext, client: Api, study: StudyInfo) -> Callable[[str], Robot]:
    return lambda name: Robot(client, machines.add(app, study.slug, name))


@pytest.fixture
def robot(new_robot: Callable[[str], Robot]) -> Robot:
    return new_robot("arm")


@pytest.fixture
def candidates(app: AppContext, study: StudyInfo) -> list[int]:
    return add_candidates(app, study.slug)


def status(app: AppContext, public_id: str) -> str:
    with app.database.read() as db:
        return db.scalars(select(Rollout.status).where(Rollout.public_id == public_id)).one()


def test_a_machine_that_is_away_is_told_at_readyz_and_on_the_overview(
    app: AppContext, client: Api, robot: Robot, candidates: list[int], clock: Clock, api_token: str
) -> None:
    def said() -> tuple[list[str], str]:
        page = client.get("/studies/robot", headers={"Authorization": f"Bearer {api_token}"})
        assert page.status_code == 200
        return client.get("/readyz").json()["warnings"], page.text

    ask(app, candidates[0])
    # Rollouts always wait for a moment.
    assert said()[0] == []
    clock.forward(31)
    warnings, page = said()
    assert warnings == ["No machine of one study is heard of, and recordings wait for one."]
    assert "No machine is heard of. One recording waits for one since 09:00" in page
    assert robot.claim(environments=[]).status_code == 204
    assert said()[0] == []
    machines.stop(app, "robot")
    warnings, page = said()
    assert warnings == ["The machines of one study are stopped, and recordings wait for them."]
    assert "The machines are stopped." in page


def test_a_cancelled_rollout_is_told_to_its_machine_and_can_be_retried(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    interventions.cancel(app, "robot", asked, "wrong gripper", "ada@lab.example")
    answer = robot.beat(asked)
    assert answer.status_code == 409
    assert "cancelled" in answer.json()["detail"]
    with pytest.raises(ConflictError):
        interventions.cancel(app, "robot", asked, "again")
    interventions.retry(app, "robot", asked, "ada@lab.example")
    assert robot.claimed()["id"] == asked


def test_a_failed_rollout_that_is_retried_has_all_its_attempts_again(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    for _ in range(2):
        robot.claimed()
        robot.failed(asked)
    assert status(app, asked) == "failed"
    interventions.retry(app, "robot", asked)
    robot.claimed()
    assert robot.failed(asked, "still jammed").json() == {"status": "asked"}
    robot.claimed()
    assert robot.failed(asked, "for good").json() == {"status": "failed"}


def test_a_rollout_is_not_retried_beside_another_of_the_same_parameters(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    interventions.cancel(app, "robot", asked, "not now")
    ask(app, candidates[0])
    with pytest.raises(ConflictError, match="one is under way"):
        interventions.retry(app, "robot", asked)


def test_responses_to_a_withdrawn_recording_leave_the_model_and_stay_in_the_record(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    with pytest.raises(ConflictError):
        box_withdrawal.withdraw(app, "robot", asked, "out of focus")
    robot.put(asked, video_bytes())
    judged = _query(app, asked, 0, is_answered=True)
    shown = _query(app, asked, 1, is_answered=False)
    with pytest.raises(ConflictError, match="reason"):
        box_withdrawal.withdraw(app, "robot", asked, "  ")
    assert box_withdrawal.withdraw(app, "robot", asked, "out of focus", "ada@lab.example") == 1
    assert status(app, asked) == "withdrawn"
    with app.database.read() as db:
        assert db.get_one(QueryRow, judged).withdrawn_at == app.now()
        assert db.get_one(QueryRow, shown).withdrawn_at is None
        assert len(db.scalars(select(Response)).all()) == 1
    line = audit_log.trail(app, "robot")[0]
    assert (line.actor, line.action) == ("ada@lab.example", "rollout withdrawn")
    assert line.details["responses"] == 1


def test_what_a_machine_recorded_from_a_time_on_is_withdrawn_and_nothing_before(
    app: AppContext,
    new_robot: Callable[[str], Robot],
    candidates: list[int],
    clock: Clock,
) -> None:
    bad, good = new_robot("bad"), new_robot("good")
    recorded = []
    for number, robot in enumerate((bad, good, bad, bad)):
        asked = ask(app, candidates[number])
        robot.claimed()
        robot.put(asked, video_bytes(20 * number))
        recorded.append(asked)
        clock.forward(3600)
    since = clock.now() - timedelta(hours=2)
    assert box_withdrawal.withdraw_machine(app, "robot", "bad", since, "bent arm") == (2, 0)
    assert [status(app, asked) for asked in recorded] == [
        "recorded",
        "recorded",
        "withdrawn",
        "withdrawn",
    ]
    with pytest.raises(NotFoundError):
        box_withdrawal.withdraw_machine(app, "robot", "nobody", since, "bent arm")


def test_the_table_of_rollouts_tells_all_of_each(
    app: AppContext, client: Api, robot: Robot, candidates: list[int], api_token: str
) -> None:
    first, second = ask(app, candidates[13]), ask(app, candidates[14])
    robot.claimed()
    robot.measure(first, score=-2.5, series={"t": [0, 1]})
    robot.put(first, video_bytes())
    robot.claimed()
    robot.failed(second, "=jammed")

    def exported(name: str) -> pd.DataFrame:
        address = f"/api/v1/studies/robot/export/{name}.csv"
        answer = client.get(address, headers={"Authorization": f"Bearer {api_token}"})
        assert answer.status_code == 200
        return pd.read_csv(io.BytesIO(answer.content)).set_index("rollout")

    table, recordings = exported("rollouts"), exported("recordings")
    done, failed = table.loc[first], table.loc[second]
    assert (done.outcome, done.machine, done.attempts) == ("recorded", "arm", 1)
    assert (done.w0, done.w1, done.seed, done.run) == (0.1, 3, 7, 0)
    assert (done.score, json.loads(str(done.series))) == (-2.5, {"t": [0, 1]})
    assert re.fullmatch("[0-9a-f]{64}", str(done.sha256))
    assert done.recording == "env1-1013-0"
    assert list(recordings.index) == [first]
    assert recordings.loc[first].recording == done.recording
    assert recordings.loc[first].machine == "arm"
    assert failed.outcome == "asked"
    assert json.loads(str(failed.failures))[0]["reason"] == "=jammed"


def test_the_ethics_page_says_what_machines_receive_where_there_are_any(
    app: AppContext, client: Api, study: StudyInfo, api_token: str
) -> None:
    page = client.get("/studies/robot/ethics", headers={"Authorization": f"Bearer {api_token}"})
    assert "What machines receive" in page.text


def _query(app: AppContext, rollout: str, index: int, *, is_answered: bool) -> int:
    """A query that shows the recording of this rollout on its left."""
    trial = add_trial(app, "robot")
    with app.database.write() as db:
        row = db.scalars(select(Rollout).where(Rollout.public_id == rollout)).one()
        query = QueryRow(
            public_id=f"q{index}",
            trial_id=trial,
            query_index=index,
            trial_type="query",
            left_candidate=db.get_one(Candidate, row.candidate_id).candidate_index,
            right_candidate=0,
            left_rollout_id=row.id,
            left_recording_id=row.recording_id,
            acquisition="random",
            seed=1,
            engine_version="1",
            created_at=app.now(),
        )
        if is_answered:
            query.response = Response(response="left", answered_at=app.now())
        db.add(query)
        db.flush()
        return query.id
