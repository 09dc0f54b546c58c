"""What tests of servers with workers share: a studio on PostgreSQL that leaves work to them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from app.services.accounts import accounts
from app.services.accounts.accounts import Principal
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.recordings.recordings import make_video
from app.services.runtime.settings import Settings
from app.services.studies import repository
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
def app(settings: Settings) -> Iterator[AppContext]:
    """That of a server."""
    app = open_app(settings, job_handlers=JOBS)
    yield app
    app.close()


@pytest.fixture
def queue(app: AppContext) -> TaskQueue:
    return TaskQueue(app.database)


@pytest.fixture
def somebody(app: AppContext) -> Principal:
    return accounts.create(app, EMAIL, PASSWORD)


@pytest.fixture
def study(app: AppContext, tmp_path: Path) -> repository.StudyInfo:
    """One of whose recordings each has a score, so that it can be simulated."""
    folder = write_own_study(tmp_path / "kettles")
    table = folder / "recordings.csv"
    table.write_text(table.read_text().replace("b.mp4,\n", "b.mp4,1\n"))
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    return repository.find(app, "kettles")


def video(app: AppContext, locator: str, *, urgent: bool = False) -> Future[Any]:
    """What recordings ask for; the candidates that tests render have short videos."""
    return app.background.in_process(
        (RENDER, locator), make_video, app.settings, locator, urgent=urgent
    )
