"""What tests of servers with workers share: a studio on PostgreSQL that leaves work to them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from app.services import accounts, studies
from app.services.accounts import Experimenter
from app.services.recordings import make_video
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from app.simulation import JOBS
from app.storage.task_queue import RENDER, TaskQueue
from tests.databases import Databases, PostgresServer

from .conftest import EMAIL, PASSWORD
from .own_study import write_own_study

TOKEN = "a-token-of-thirty-two-characters!"


@pytest.fixture
def server(databases: Databases) -> PostgresServer:
    assert isinstance(databases, PostgresServer)
    return databases


@pytest.fixture
def settings(server: PostgresServer, tmp_path: Path) -> Settings:
    return Settings(
        database_url=server.new(tmp_path),
        data_dir=tmp_path / "data",
        media_dir=tmp_path / "media",
        metrics_token=SecretStr(TOKEN),
        workers_apart=True,
    )


@pytest.fixture
def studio(settings: Settings) -> Iterator[Studio]:
    """That of a server."""
    studio = open_studio(settings, works=JOBS)
    yield studio
    studio.close()


@pytest.fixture
def queue(studio: Studio) -> TaskQueue:
    return TaskQueue(studio.database)


@pytest.fixture
def somebody(studio: Studio) -> Experimenter:
    return accounts.create(studio, EMAIL, PASSWORD)


@pytest.fixture
def study(studio: Studio, tmp_path: Path) -> studies.StudyInfo:
    """One of whose recordings each has a score, so that it can be simulated."""
    folder = write_own_study(tmp_path / "kettles")
    table = folder / "recordings.csv"
    table.write_text(table.read_text().replace("b.mp4,\n", "b.mp4,1\n"))
    studies.create(studio, studies.load_folder(str(folder)))
    studies.open_study(studio, "kettles")
    return studies.find(studio, "kettles")


def video(studio: Studio, locator: str, *, urgent: bool = False) -> Future[Any]:
    """What recordings ask for; the candidates that tests render have short videos."""
    return studio.background.in_process(
        (RENDER, locator), make_video, studio.settings, locator, urgent=urgent
    )
