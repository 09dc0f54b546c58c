"""The machine inside the server: the simulated crane records what is asked of it."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from sqlalchemy import select

from app.services.background.interface import Background
from app.services.background.local import LocalBackground
from app.services.context import AppContext
from app.services.recordings.recordings import FoundSource
from app.services.rollouts import claims, crane_machine, machines
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Recording
from tests.conftest import Clock, StudyShelf

from .machine_study import ROBOT_PLAN, add_candidates, ask

LIVE_PLAN = ROBOT_PLAN.replace("source: machine", "source: machine crane").replace(
    "max: 10", "max: 1"
)
#: Longer than any rendering takes on a busy machine.
PATIENCE_S = 60.0


class AtOnce(LocalBackground):
    """Renders in the calling thread: a process takes longer to begin than the rendering does."""

    def in_process(self, key, function, *args, urgent=False):  # type: ignore[no-untyped-def]
        return self.in_thread(key, function, *args)


@pytest.fixture
def background() -> Background:
    return AtOnce(1)


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, LIVE_PLAN)
    return repository.find(app, "robot")


def test_the_crane_records_a_rollout_with_its_score_and_weights(
    app: AppContext, study: StudyInfo, tmp_path: Path
) -> None:
    candidate = add_candidates(app, study.slug)[41]
    asked = ask(app, candidate)
    assert crane_machine.work_once(app)
    assert not crane_machine.work_once(app)
    with app.database.read() as db:
        rollout = db.scalars(select(Rollout)).one()
        recording = db.scalars(select(Recording)).one()
    assert (rollout.public_id, rollout.status, rollout.attempt) == (asked, "recorded", 1)
    assert rollout.recording_id == recording.id
    assert rollout.score is not None
    assert rollout.series is not None
    assert len(rollout.series["weight_g"]) == 501
    found = FoundSource(recording.source, recording.locator)
    assert app.recordings.copy_to(found, tmp_path / "run.mp4")


def test_a_machine_outside_gets_nothing_of_the_crane(app: AppContext, study: StudyInfo) -> None:
    ask(app, add_candidates(app, study.slug)[0])
    with app.database.write() as db:
        row = machines.without_token(db, study.id, "arm", app.now())
        caller = machines.MachineCaller(row.id, row.name, study.id, study.slug)
    assert claims.claim(app, caller) is None


def test_while_machines_are_stopped_the_crane_records_nothing(
    app: AppContext, study: StudyInfo
) -> None:
    ask(app, add_candidates(app, study.slug)[0])
    machines.stop(app, study.slug)
    assert not crane_machine.work_once(app)
    machines.release(app, study.slug)
    assert crane_machine.work_once(app)


def test_what_a_killed_server_had_claimed_is_recorded_by_the_next_one(
    app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    ask(app, add_candidates(app, study.slug)[0])
    with app.database.write() as db:
        row = machines.without_token(db, study.id, machines.INSIDE, app.now())
        killed = machines.MachineCaller(row.id, row.name, study.id, study.slug)
    assert claims.claim(app, killed, inside=True, lease=crane_machine.LEASE) is not None
    assert not crane_machine.work_once(app)
    clock.forward(crane_machine.LEASE.total_seconds() + 1)
    assert crane_machine.work_once(app)
    with app.database.read() as db:
        rollout = db.scalars(select(Rollout)).one()
    assert (rollout.status, rollout.attempt) == ("recorded", 2)


def test_a_running_server_records_what_is_asked_without_being_told(
    app: AppContext, study: StudyInfo
) -> None:
    candidate = add_candidates(app, study.slug)[0]
    ends = time.monotonic() + PATIENCE_S
    with crane_machine.running(app):
        ask(app, candidate)
        is_recorded = threading.Event()
        while not is_recorded.wait(0.05) and time.monotonic() < ends:
            with app.database.read() as db:
                if db.scalars(select(Rollout.status)).one() == "recorded":
                    is_recorded.set()
    assert is_recorded.is_set()
