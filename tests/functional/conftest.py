"""The application as its users reach it: over HTTP, without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI

from app.main import create_app
from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, Clock, Idle, StudyShelf
from tests.databases import Databases, commit_quickly

from .client import Api
from .house import House, Kept

#: Opens the short study with further lines in its plan.
Recruit = Callable[[str], StudyInfo]

EMAIL = "ada@lab.example"
PASSWORD = "correct horse battery"


@pytest.fixture(scope="package", autouse=True)
def _quick_commits() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        commit_quickly(patch)
        yield


@pytest.fixture(scope="session")
def _assembled(tmp_path_factory: pytest.TempPathFactory, media_dir: Path) -> Iterator[FastAPI]:
    """One application for all tests: putting its routes together takes longer than most tests."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("unused"), media_dir=media_dir)
    app = open_app(settings, background=Idle(1))
    yield create_app(app=app)
    app.close()


@pytest.fixture
def application(_assembled: FastAPI, app: AppContext) -> FastAPI:
    """The application over this test's studio, which nobody has told to stop."""
    _assembled.state.app = app
    _assembled.state.stopping = lambda: False
    return _assembled


@pytest.fixture
def client(application: FastAPI) -> Iterator[Api]:
    with Api(application) as api:
        yield api


@pytest.fixture
def api_token(app: AppContext) -> str:
    """An experimenter's API token."""
    return accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")


#: The short study with a model from the second answer on, so that a few queries show all kinds.
LEARNING_PLAN = SHORT_PLAN.replace(
    "settings: {preset: paper-env1}", "settings: {preset: paper-env1, random_queries: 2}"
).replace("queries_per_trial: 4", "queries_per_trial: 5")


@pytest.fixture
def learning_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    """An open study in which the model chooses queries after two answers."""
    study_shelf.put_into(app, LEARNING_PLAN)
    return repository.find(app, "short")


@pytest.fixture
def recruit(app: AppContext, study_shelf: StudyShelf) -> Recruit:
    """Opens the short study with these further lines in its plan."""

    def opened(said: str) -> StudyInfo:
        study_shelf.put_into(app, SHORT_PLAN + said)
        return repository.find(app, "short")

    return opened


@pytest.fixture(scope="module")
def kept(
    databases: Databases,
    study_shelf: StudyShelf,
    media_dir: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Kept:
    folder = tmp_path_factory.mktemp("house")
    settings = Settings(
        data_dir=folder / "data",
        media_dir=media_dir,
        database_url=databases.new(folder / "data"),
    )
    app = open_app(settings, now=Clock().now, background=Idle(1))
    study_shelf.put_into(app, SHORT_PLAN)
    made = Kept(app, databases, folder / "kept")
    app.close()
    return made


@pytest.fixture
def house(
    client: Api, application: FastAPI, app: AppContext, databases: Databases, kept: Kept
) -> House:
    # Streams end at once, as they do when a server is told to stop.
    application.state.stopping = lambda: True
    return House(client, app, databases, kept)
