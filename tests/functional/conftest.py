"""The application as its users reach it: over HTTP, without a network."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from fastapi import FastAPI

from app.main import create_app
from app.services import accounts
from app.services.studio import Studio

from .client import Api

EMAIL = "ada@lab.example"
PASSWORD = "correct horse battery"


@pytest.fixture
def application(studio: Studio) -> FastAPI:
    return create_app(studio=studio)


@pytest.fixture
def client(application: FastAPI) -> Iterator[Api]:
    with Api(application) as api:
        yield api


@pytest.fixture
def api_token(studio: Studio) -> str:
    """An experimenter's API token."""
    return accounts.create_api_token(studio, accounts.create(studio, EMAIL, PASSWORD), "tests")
