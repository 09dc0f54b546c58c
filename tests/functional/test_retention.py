"""Retention: what is due is deleted by itself, what is not stays, and the trail tells of it."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select

from app.services import audit, periodic_tasks, results, retention
from app.services.retention import Swept
from app.services.studies import StudyInfo
from app.services.studio import Studio
from app.services.watching.troubles import troubles
from app.storage.arrivals import Tombstone
from app.storage.tables import Identity, PlanVersion, SessionRow, Study
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


def ids(studio: Studio) -> list[str]:
    with studio.database.read() as session:
        return list(session.scalars(select(Identity.value).order_by(Identity.id)))


def sessions(studio: Studio) -> int:
    with studio.database.read() as session:
        return len(session.scalars(select(SessionRow.id)).all())


def test_identities_go_first_and_then_everything(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(10 * DAY - 1)
    assert retention.run(studio) == {}
    clock.forward(1)
    assert retention.run(studio, dry_run=True) == {"short": Swept(0, 1)}
    assert ids(studio) == [PLATFORM_ID]
    assert retention.run(studio) == {"short": Swept(0, 1)}
    assert (ids(studio), sessions(studio)) == ([], 1)
    clock.forward(10 * DAY - 1)
    assert retention.run(studio) == {}
    clock.forward(1)
    assert retention.run(studio) == {"short": Swept(1, 0)}
    assert rows_of_people(studio) == {"tombstones": 1}
    with studio.database.read() as session:
        stone = session.scalars(select(Tombstone)).one()
        assert (stone.reason, stone.stage, stone.deleted_at.hour) == ("retention", "withdrawn", 0)
    assert results.deleted(studio, study.id) == 0


def test_the_trail_tells_how_many_and_nobodys_name(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client, "one")
    passage(client, "two")
    clock.forward(20 * DAY)
    retention.run(studio)
    line = audit.trail(studio)[0]
    assert (line.actor, line.action, line.study_slug) == (
        "retention rule",
        "retention carried out",
        "short",
    )
    assert line.details == {"sessions_deleted": 2, "people_whose_ids_were_deleted": 2}
    retention.run(studio)
    assert audit.trail(studio)[0] == line


def test_an_unfinished_session_is_counted_from_its_expiry(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    client.start().to_first_query().respond("left")
    clock.forward((14 + 20) * DAY - 1)
    assert retention.run(studio) == {}
    clock.forward(1)
    assert retention.run(studio)["short"].sessions == 1


def test_somebody_who_came_again_keeps_their_ids_and_loses_the_older_session(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(15 * DAY)
    passage(client)
    assert retention.run(studio) == {}
    clock.forward(5 * DAY)
    assert retention.run(studio) == {"short": Swept(1, 0)}
    assert (ids(studio), sessions(studio)) == ([PLATFORM_ID], 1)
    clock.forward(15 * DAY)
    assert retention.run(studio) == {"short": Swept(1, 1)}
    assert rows_of_people(studio) == {"tombstones": 2}


def test_one_study_whose_plan_cannot_be_read_keeps_no_others_people(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock, pbpo: Run
) -> None:
    passage(client)
    clock.forward(20 * DAY)
    with studio.database.write() as session:
        broken = Study(slug="broken", status="open", created_at=clock.now())
        session.add(broken)
        session.flush()
        broken_id = broken.id
        session.add(
            PlanVersion(
                study_id=broken_id,
                version=1,
                plan_hash="0" * 64,
                plan={"slug": "broken"},
                texts={},
                created_at=clock.now(),
            )
        )
    assert retention.run(studio, dry_run=True)["broken"] == Swept(failed=True)
    assert told(studio, study, broken_id) == []
    swept = retention.run(studio)
    assert swept == {"short": Swept(1, 1), "broken": Swept(failed=True)}
    (said,) = told(studio, study, broken_id)
    assert said.startswith("One hourly sweep of what this study has promised to delete failed.")
    assert told(studio, study, study.id) == []
    told_so = pbpo("retention", "run")
    assert told_so.status == 1
    assert "broken: it failed" in told_so.out


def told(studio: Studio, study: StudyInfo, study_id: int) -> list[str]:
    """What the overview of the study of this id says went wrong."""
    return [trouble.said for trouble in troubles(studio, replace(study, id=study_id))]


def test_without_a_rule_nothing_is_deleted(
    client: Api, studio: Studio, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    passage(client)
    clock.forward(3650 * DAY)
    assert retention.run(studio) == {}
    assert sessions(studio) == 1


def test_two_sweeps_at_once_delete_each_session_once(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    for number in range(6):
        passage(client, f"person {number}")
    clock.forward(20 * DAY)
    with ThreadPoolExecutor(3) as pool:
        swept = list(pool.map(lambda _: retention.run(studio), range(3)))
    assert sum(one["short"].sessions for one in swept if one) == 6
    assert rows_of_people(studio) == {"tombstones": 6}


def test_a_sweep_that_is_stopped_tells_what_it_did_and_is_taken_up_again(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client, "one")
    passage(client, "two")
    clock.forward(20 * DAY)
    asked = iter([False, False, False, True])
    assert retention.run(studio, stop=lambda: next(asked)) == {"short": Swept(1, 2)}
    assert audit.trail(studio)[0].details["sessions_deleted"] == 1
    assert retention.run(studio) == {"short": Swept(1, 0)}


@pytest.mark.sqlite
def test_nothing_of_the_people_is_left_on_the_disk(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    file = database_file(studio.settings)
    files = [file, file.with_name(f"{file.name}-wal")]
    assert any(PLATFORM_ID.encode() in path.read_bytes() for path in files)
    clock.forward(20 * DAY)
    retention.run(studio)
    assert not any(PLATFORM_ID.encode() in path.read_bytes() for path in files)


def test_the_server_sweeps_when_it_starts(
    client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    passage(client)
    clock.forward(20 * DAY)
    with periodic_tasks.running(studio, of_the_studio=True):
        deadline = time.monotonic() + 30
        while sessions(studio) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert sessions(studio) == 0


def test_the_command_says_what_is_due_and_deletes_it(
    pbpo: Run, tmp_path: Path, client: Api, studio: Studio, study: StudyInfo, clock: Clock
) -> None:
    assert pbpo("retention", "run").out == "Nothing is due.\n"
    passage(client)
    with studio.database.write() as session:
        row = session.scalars(select(SessionRow)).one()
        row.ended_at = row.started_at.replace(year=2020)
    told = "short: sessions that {0} deleted: 1; people whose platform ids {0} deleted: 1\n"
    assert pbpo("retention", "run", "--dry-run").out == told.format("would be")
    assert sessions(studio) == 1
    assert pbpo("retention", "run").out == told.format("were")
    assert rows_of_people(studio) == {"tombstones": 1}
    assert audit.trail(studio)[0].actor == "command line"
