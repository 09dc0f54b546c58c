"""Work that is asked for and watched: begun, reported, failed, and begun again after a silence."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import update

from app.services import jobs
from app.services.accounts.accounts import Role
from app.services.background.interface import Background
from app.services.background.job_function import JobHandler, ProgressCallback
from app.services.background.local import LocalBackground
from app.services.context import AppContext, utc_now
from app.services.runtime.errors import ServiceError
from app.services.runtime.settings import Settings
from app.storage.models.records import Job
from tests.conftest import Idle
from tests.videos import write

from .client import Api
from .desk import Desk, zipped
from .own_study import write_own_study

PATIENCE_S = 60


def good(_settings: Settings, request: Mapping[str, Any], report: ProgressCallback) -> str:
    report(1, 4)
    return f"did {request['what']}"


def bad(_settings: Settings, _request: Mapping[str, Any], _report: ProgressCallback) -> str:
    raise ValueError("there was nothing to do")


class AtOnce(Idle):
    """Jobs are done where they are asked for, so that a test need not wait for a process."""

    def as_job(
        self,
        key: Any,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        function(*args)


class Never(Idle):
    """Jobs are not begun: as if the server had been stopped before."""

    def as_job(
        self,
        key: Any,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        return None


@pytest.fixture
def background() -> Background:
    return AtOnce(1)


@pytest.fixture
def job_handlers() -> Mapping[str, JobHandler]:
    return {"good": good, "bad": bad}


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def test_a_job_is_done_and_says_what_came_of_it(desk: Desk, app: AppContext, client: Api) -> None:
    asked = jobs.enqueue(app, desk.account, "good", {"what": "this"})
    told = desk.get(f"/jobs/{asked.public_id}").json()
    assert told == {"state": "done", "done": 4, "total": 4, "message": "did this", "is_over": True}
    other = Desk(client, app, "ada@lab.example", Role.ADMIN)
    assert other.get(f"/jobs/{asked.public_id}").status_code == 404


def test_a_job_that_fails_says_why(desk: Desk, app: AppContext) -> None:
    asked = jobs.enqueue(app, desk.account, "bad", {})
    told = jobs.status(app, desk.account, asked.public_id)
    assert (told.state, told.message) == ("failed", "there was nothing to do")


def test_work_that_there_is_none_of_is_refused(desk: Desk, app: AppContext) -> None:
    with pytest.raises(ServiceError, match="expected work among"):
        jobs.enqueue(app, desk.account, "nothing", {})


class TestStopped:
    @pytest.fixture
    def background(self) -> Background:
        return Never(1)

    def test_the_same_asked_twice_is_one_job(self, desk: Desk, app: AppContext) -> None:
        first, again, other = (
            jobs.enqueue(app, desk.account, "good", {"what": what}) for what in ("a", "a", "b")
        )
        assert first.public_id == again.public_id != other.public_id

    def test_a_job_that_fell_silent_is_begun_again_and_one_in_hand_is_not(
        self, desk: Desk, app: AppContext
    ) -> None:
        asked = jobs.enqueue(app, desk.account, "good", {"what": "this"})

        def seen(ago: timedelta) -> None:
            with app.database.write() as db:
                db.execute(update(Job).values(state="running", seen_at=utc_now() - ago))

        seen(timedelta(seconds=1))
        jobs.run(app.settings, asked.public_id, good)
        assert jobs.status(app, desk.account, asked.public_id).state == "running"
        seen(jobs.SILENT_AFTER + timedelta(seconds=1))
        jobs.run(app.settings, asked.public_id, good)
        assert jobs.status(app, desk.account, asked.public_id).state == "done"


class TestInAProcess:
    @pytest.fixture
    def background(self) -> Background:
        return LocalBackground(1)

    def test_videos_are_transcoded_in_a_process_and_the_study_is_sound(
        self, desk: Desk, app: AppContext, tmp_path: Path
    ) -> None:
        folder = write_own_study(tmp_path / "kettles")
        (folder / "videos" / "a.mp4").unlink()
        write(folder / "videos" / "a.avi", "mpeg4")
        table = folder / "recordings.csv"
        table.write_text(table.read_text().replace("videos/a.mp4", "videos/a.avi"))
        here = desk.begin({"kettles.zip": zipped(folder)})
        page = desk.get(here).text
        assert "Transcode 1 video<" in page
        assert "mpeg4" in page or "avi" in page
        assert desk.post(f"{here}/transcode").status_code == 303
        deadline = time.monotonic() + PATIENCE_S
        while "No fault found" not in (page := desk.get(here).text):
            assert "Transcoding failed" not in page
            assert time.monotonic() < deadline, page
            time.sleep(0.2)
        assert "videos/a.avi" not in page
        assert "videos/a.mp4" in page
