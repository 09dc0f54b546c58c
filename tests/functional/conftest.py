"""The application as its users reach it: over HTTP, without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI

from app.main import create_app
from app.services import accounts, studies
from app.services.settings import Settings
from app.services.studies import StudyInfo
from app.services.studio import Studio, open_studio
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
    studio = open_studio(settings, background=Idle(1))
    yield create_app(studio=studio)
    studio.close()


@pytest.fixture
def application(_assembled: FastAPI, studio: Studio) -> FastAPI:
    """The application over this test's studio, which nobody has told to stop."""
    _assembled.state.studio = studio
    _assembled.state.stopping = lambda: False
    return _assembled


@pytest.fixture
def client(application: FastAPI) -> Iterator[Api]:
    with Api(application) as api:
        yield api


@pytest.fixture
def api_token(studio: Studio) -> str:
    """An experimenter's API token."""
    return accounts.create_api_token(studio, accounts.create(studio, EMAIL, PASSWORD), "tests")


#: The short study with a model from the second answer on, so that a few queries show all kinds.
LEARNING_PLAN = SHORT_PLAN.replace(
    "settings: {preset: paper-env1}", "settings: {preset: paper-env1, random_queries: 2}"
).replace("queries_per_trial: 4", "queries_per_trial: 5")


@pytest.fixture
def learning_study(studio: Studio, study_shelf: StudyShelf) -> StudyInfo:
    """An open study in which the model chooses queries after two answers."""
    study_shelf.put_into(studio, LEARNING_PLAN)
    return studies.find(studio, "short")


@pytest.fixture
def recruit(studio: Studio, study_shelf: StudyShelf) -> Recruit:
    """Opens the short study with these further lines in its plan."""

    def opened(said: str) -> StudyInfo:
        study_shelf.put_into(studio, SHORT_PLAN + said)
        return studies.find(studio, "short")

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
    studio = open_studio(settings, now=Clock().now, background=Idle(1))
    study_shelf.put_into(studio, SHORT_PLAN)
    made = Kept(studio, databases, folder / "kept")
    studio.close()
    return made


@pytest.fixture
def house(
    client: Api, application: FastAPI, studio: Studio, databases: Databases, kept: Kept
) -> House:
    # Streams end at once, as they do when a server is told to stop.
    application.state.stopping = lambda: True
    return House(client, studio, databases, kept)
