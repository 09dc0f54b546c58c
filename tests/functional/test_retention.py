"""Retention: what is due is deleted by itself, what is not stays, and the trail tells of it."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.maintenance import periodic_tasks, retention
from app.services.maintenance.retention import CleanupResult
from app.services.monitoring import session_list
from app.services.monitoring.incidents import incidents
from app.services.studies.repository import StudyInfo
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import Identity, PlanVersion, SessionRow, Study
from tests.conftest import Clock, database_file

from .client import Api, Session
from .conftest import Recruit
from .test_commands import Run, pbpo
from .test_leaving import rows_of_people

__all__ = ["pbpo"]

DAY = 24 * 3600.0
RULE = "retention: {identity_days: 10, everything_days: 20}\n"
PROLIFIC = "recruitment: {platform: prolific, codes: {completed: C1}, returning: again}\n"
PLATFORM_ID = "5f0c1ada-prolific"


@pytest.fixture
def study(recruit: Recruit) -> StudyInfo:
    return recruit(RULE + PROLIFIC)


def passage(client: Api, person: str = PLATFORM_ID) -> Session:
    """A session that its person left after an answer, and stopped."""
    session = client.start(external_ids={"PROLIFIC_PID": person})
    session.to_first_query().respond("left")
    session.call("withdraw")
    return session


def ids(app: AppContext) -> list[str]:
    with app.database.read() as db:
        return list(db.scalars(select(Identity.value).order_by(Identity.id)))


def sessions(app: AppContext) -> int:
    with app.database.read() as db:
        return len(db.scalars(select(SessionRow.id)).all())


def test_identities_go_first_and_then_everything(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(10 * DAY - 1)
    assert retention.run(app) == {}
    clock.forward(1)
    assert retention.run(app, dry_run=True) == {"short": CleanupResult(0, 1)}
    assert ids(app) == [PLATFORM_ID]
    assert retention.run(app) == {"short": CleanupResult(0, 1)}
    assert (ids(app), sessions(app)) == ([], 1)
    clock.forward(10 * DAY - 1)
    assert retention.run(app) == {}
    clock.forward(1)
    assert retention.run(app) == {"short": CleanupResult(1, 0)}
    assert rows_of_people(app) == {"tombstones": 1}
    with app.database.read() as db:
        stone = db.scalars(select(Tombstone)).one()
        assert (stone.reason, stone.stage, stone.deleted_at.hour) == ("retention", "withdrawn", 0)
    assert session_list.deleted(app, study.id) == 0


def test_the_trail_tells_how_many_and_nobodys_name(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client, "one")
    passage(client, "two")
    clock.forward(20 * DAY)
    retention.run(app)
    line = audit_log.trail(app)[0]
    assert (line.actor, line.action, line.study_slug) == (
        "retention rule",
        "retention carried out",
        "short",
    )
    assert line.details == {"sessions_deleted": 2, "people_whose_ids_were_deleted": 2}
    retention.run(app)
    assert audit_log.trail(app)[0] == line


def test_an_unfinished_session_is_counted_from_its_expiry(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    client.start().to_first_query().respond("left")
    clock.forward((14 + 20) * DAY - 1)
    assert retention.run(app) == {}
    clock.forward(1)
    assert retention.run(app)["short"].sessions == 1


def test_an_id_that_came_again_is_another_participant_with_times_of_their_own(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(15 * DAY)
    passage(client)
    # An id alone proves nothing, so the two are not joined.
    assert retention.run(app) == {"short": CleanupResult(0, 1)}
    assert (ids(app), sessions(app)) == ([PLATFORM_ID], 2)
    clock.forward(5 * DAY)
    assert retention.run(app) == {"short": CleanupResult(1, 0)}
    assert (ids(app), sessions(app)) == ([PLATFORM_ID], 1)
    clock.forward(15 * DAY)
    assert retention.run(app) == {"short": CleanupResult(1, 1)}
    assert rows_of_people(app) == {"tombstones": 2}


def test_one_study_whose_plan_cannot_be_read_keeps_no_others_people(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock, pbpo: Run
) -> None:
    passage(client)
    clock.forward(20 * DAY)
    with app.database.write() as db:
        broken = Study(slug="broken", status="open", created_at=clock.now())
        db.add(broken)
        db.flush()
        broken_id = broken.id
        db.add(
            PlanVersion(
                study_id=broken_id,
                version=1,
                plan_hash="0" * 64,
                plan={"slug": "broken"},
                texts={},
                created_at=clock.now(),
            )
        )
    assert retention.run(app, dry_run=True)["broken"] == CleanupResult(failed=True)
    assert told(app, study, broken_id) == []
    swept = retention.run(app)
    assert swept == {"short": CleanupResult(1, 1), "broken": CleanupResult(failed=True)}
    (said,) = told(app, study, broken_id)
    assert said.startswith("One hourly sweep of what this study has promised to delete failed.")
    assert told(app, study, study.id) == []
    told_so = pbpo("retention", "run")
    assert told_so.status == 1
    assert "broken: it failed" in told_so.out


def told(app: AppContext, study: StudyInfo, study_id: int) -> list[str]:
    """What the overview of the study of this id says went wrong."""
    return [trouble.said for trouble in incidents(app, replace(study, id=study_id))]


def test_without_a_rule_nothing_is_deleted(
    client: Api, app: AppContext, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    passage(client)
    clock.forward(3650 * DAY)
    assert retention.run(app) == {}
    assert sessions(app) == 1


def test_two_sweeps_at_once_delete_each_session_once(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    for number in range(6):
        passage(client, f"person {number}")
    clock.forward(20 * DAY)
    with ThreadPoolExecutor(3) as pool:
        swept = list(pool.map(lambda _: retention.run(app), range(3)))
    assert sum(one["short"].sessions for one in swept if one) == 6
    assert rows_of_people(app) == {"tombstones": 6}


def test_a_sweep_that_is_stopped_tells_what_it_did_and_is_taken_up_again(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client, "one")
    passage(client, "two")
    clock.forward(20 * DAY)
    asked = iter([False, False, False, True])
    assert retention.run(app, stop=lambda: next(asked)) == {"short": CleanupResult(1, 2)}
    assert audit_log.trail(app)[0].details["sessions_deleted"] == 1
    assert retention.run(app) == {"short": CleanupResult(1, 0)}


@pytest.mark.sqlite
def test_nothing_of_the_people_is_left_on_the_disk(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    file = database_file(app.settings)
    files = [file, file.with_name(f"{file.name}-wal")]
    assert any(PLATFORM_ID.encode() in path.read_bytes() for path in files)
    clock.forward(20 * DAY)
    retention.run(app)
    assert not any(PLATFORM_ID.encode() in path.read_bytes() for path in files)


def test_the_server_sweeps_when_it_starts(
    client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(20 * DAY)
    with periodic_tasks.running(app, of_the_studio=True):
        deadline = time.monotonic() + 30
        while sessions(app) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert sessions(app) == 0


def test_the_command_says_what_is_due_and_deletes_it(
    pbpo: Run, tmp_path: Path, client: Api, app: AppContext, study: StudyInfo, clock: Clock
) -> None:
    assert pbpo("retention", "run").out == "Nothing is due.\n"
    passage(client)
    with app.database.write() as db:
        row = db.scalars(select(SessionRow)).one()
        row.ended_at = row.started_at.replace(year=2020)
    told = "short: sessions that {0} deleted: 1; people whose platform ids {0} deleted: 1\n"
    assert pbpo("retention", "run", "--dry-run").out == told.format("would be")
    assert sessions(app) == 1
    assert pbpo("retention", "run").out == told.format("were")
    assert rows_of_people(app) == {"tombstones": 1}
    assert audit_log.trail(app)[0].actor == "command line"
