"""What tests of several rooms share: a study of one's own, and the time of day in hand.

`pytest --database postgresql` runs them on a PostgreSQL server of their own. Those marked `sqlite`,
about SQLite's files, are left out then; those marked `postgresql`, about workers say, otherwise.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import Future
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import hypothesis
import pytest
from argon2 import PasswordHasher, Type
from sqlalchemy import func, select

from app.services.accounts import accounts
from app.services.background.interface import Background
from app.services.background.job_function import JobHandler
from app.services.background.local import LocalBackground
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.storage.models.accounts import Account

from .databases import Databases, PostgresServer, SqliteFiles, compile_once

pytest_plugins = ["tests.fuzz.plugin"]

T = TypeVar("T")

# The same examples each time; a busy machine may take its time over one.
hypothesis.settings.register_profile("steady", derandomize=True, deadline=None)
hypothesis.settings.load_profile("steady")

STARTED = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)


class Clock:
    """A clock that stands still until it is told to go on."""

    def __init__(self) -> None:
        self.time = STARTED

    def now(self) -> datetime:
        return self.time

    def forward(self, seconds: float) -> None:
        self.time += timedelta(seconds=seconds)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(scope="session", autouse=True)
def _quick_passwords() -> Iterator[None]:
    """Hash the passwords of tests in a millisecond: a real hash takes a tenth of a second."""
    # OWASP's least for Argon2id; what people's passwords get is held here.
    assert accounts._hasher.memory_cost >= 19 * 1024
    assert accounts._hasher.type is Type.ID
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accounts, "_hasher", PasswordHasher(1, 8, 1))
        yield


@pytest.fixture(scope="session", autouse=True)
def _statements_compiled_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        compile_once(patch)
        yield


@pytest.fixture
def settings(tmp_path: Path, media_dir: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", media_dir=media_dir)


@pytest.fixture(scope="session")
def media_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rendered recordings, shared by all tests of a run (and by runs, where one is named)."""
    if named := os.environ.get("PBPO_TEST_MEDIA_DIR"):
        return Path(named)
    # Tests that run in several processes have a folder each, within one of the run's.
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "media"
    folder.mkdir(exist_ok=True)
    return folder


class NoRendering(LocalBackground):
    """Background work that renders nothing: videos asked for never come."""

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        return Future()


class Idle(NoRendering):
    """No background work at all: what comes next is worked out when it is asked for."""

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        return Future()


@pytest.fixture
def background() -> Background:
    """What the studio leaves to the background: nothing, unless a test's room says otherwise."""
    return Idle(1)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--database", choices=["sqlite", "postgresql"], default="sqlite")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    other = "sqlite" if config.getoption("--database") == "postgresql" else "postgresql"
    left_out = {item for item in items if item.get_closest_marker(other)}
    config.hook.pytest_deselected(items=[item for item in items if item in left_out])
    items[:] = [item for item in items if item not in left_out]
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@pytest.fixture(scope="session")
def databases(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Databases]:
    """The kind of database that this run is about."""
    on_postgres = request.config.getoption("--database") == "postgresql"
    kind = PostgresServer if on_postgres else SqliteFiles
    # A socket's path may not be longer than some 100 bytes.
    with tempfile.TemporaryDirectory(prefix="pbpo-") as folder:
        made = kind(Path(folder))
        yield made
        made.close()


@pytest.fixture(autouse=True)
def _on_this_runs_database(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[None]:
    """Whatever a test starts, in this process or another, finds its database by itself.

    SQLite's file lies in the data folder by default; a PostgreSQL database is named.
    """
    if request.config.getoption("--database") != "postgresql":
        yield
        return
    databases: PostgresServer = request.getfixturevalue("databases")
    url = databases.new(tmp_path)
    monkeypatch.setenv("PBPO_DATABASE_URL", url)
    yield
    databases.give_back(url)


@pytest.fixture
def job_handlers() -> Mapping[str, JobHandler]:
    """Further kinds of job: none, unless a test's module says otherwise."""
    return {}


@pytest.fixture
def app(
    settings: Settings,
    clock: Clock,
    background: Background,
    databases: Databases,
    job_handlers: Mapping[str, JobHandler],
) -> Iterator[AppContext]:
    """A studio with nothing in it, which renders no videos."""
    if not settings.database_url:
        databases.new(settings.data_dir)
    # Seeds 1, 2, 3, ...: a test asks the same queries each time it runs.
    seed = count(1).__next__
    app = open_app(
        settings, now=clock.now, seed=seed, background=background, job_handlers=job_handlers
    )
    yield app
    app.close()


SHORT_PLAN = """
version: 1
slug: short
title: {en: A short study}
languages: [en]
parameters:
  - {name: w0, label: Opening time, unit: s}
  - {name: w1, label: Closing time, unit: s}
environments:
  env1: {label: Clumps, source: crane}
conditions:
  - name: pbpo
    method: pbpo
    environment: env1
    skip: {label: {en: I don't like either.}}
    settings: {preset: paper-env1}
  - name: no-synthesis
    method: pbpo-no-synthesis
    environment: env1
    skip: {label: {en: It's hard to choose.}}
    settings: {preset: paper-env1}
  - name: no-skip
    method: pbpo-no-skip
    environment: env1
    settings: {preset: paper-env1}
trials_per_condition: 1
queries_per_trial: 4
break_s: 120
familiarisation: {videos: 2, required: 0}
"""

#: What is added to a plan whose participants come from Prolific, with its identifiers.
FROM_PROLIFIC = "recruitment: {platform: prolific, codes: {completed: C1}}\n"


def write_study(folder: Path, plan: str = SHORT_PLAN) -> Path:
    """A study folder with this plan and short texts."""
    texts = folder / "texts" / "en"
    texts.mkdir(parents=True)
    (folder / "study.yaml").write_text(plan, encoding="utf-8")
    (texts / "consent.md").write_text("You choose between videos. You may stop at any time.\n")
    (texts / "instructions.md").write_text("Choose the video in which waste falls evenly.\n")
    (texts / "debrief.md").write_text("Your choices taught an optimiser. Thank you.\n")
    return folder


class StudyShelf:
    """What databases with one open study hold: made once per plan, put wherever wanted."""

    def __init__(self, databases: Databases, folder: Path, media_dir: Path) -> None:
        self._databases = databases
        self._folder = folder
        self._media_dir = media_dir
        self._made: dict[str, Any] = {}

    def put_into(self, app: AppContext, plan: str) -> None:
        """Replace what the studio's database holds by the open study of this plan."""
        with app.database.read() as db:
            people = db.scalar(select(func.count(Account.id)))
            assert people == 0, "expected the study first: it takes the place of what is there"
        self._databases.put_into(app.settings.url, self._with(plan))

    def _with(self, plan: str) -> Any:
        if plan not in self._made:
            place = self._folder / str(len(self._made))
            settings = Settings(
                data_dir=place / "data",
                media_dir=self._media_dir,
                database_url=self._databases.new(place / "data"),
            )
            folder = repository.load_folder(str(write_study(place / "study", plan)))
            app = open_app(settings, now=Clock().now, background=Idle(1))
            repository.create(app, folder)
            repository.open_study(app, folder.plan.slug)
            app.close()
            self._made[plan] = self._databases.keep(settings.url)
        return self._made[plan]


def database_file(settings: Settings) -> Path:
    return settings.data_dir / "pbpo.sqlite3"


@pytest.fixture(scope="session")
def study_shelf(
    databases: Databases, tmp_path_factory: pytest.TempPathFactory, media_dir: Path
) -> StudyShelf:
    return StudyShelf(databases, tmp_path_factory.mktemp("studies"), media_dir)


@pytest.fixture
def short_study(app: AppContext, study_shelf: StudyShelf) -> repository.StudyInfo:
    """An open study on the crane: three conditions, one trial of four queries each."""
    study_shelf.put_into(app, SHORT_PLAN)
    return repository.find(app, "short")
