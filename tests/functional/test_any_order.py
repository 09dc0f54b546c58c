"""Two sessions at once, by any actions in any order: short here, at length by `make fuzz`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from hypothesis import seed as seeded
from hypothesis.stateful import run_state_machine_as_test

from app.services.accounts import accounts
from app.services.background.interface import Background
from app.services.bootstrap import open_app
from app.services.context import AppContext
from tests.conftest import FROM_PROLIFIC, Clock, StudyShelf
from tests.fuzz.passage import Passage
from tests.fuzz.person import PLAN
from tests.fuzz.plugin import Fuzz
from tests.fuzz.told import World

from .client import Api
from .conftest import EMAIL, PASSWORD

PART = "two sessions in any order"


class Counted(Api):
    """A client that notes what it asked."""

    def __init__(self, application: FastAPI, fuzz: Fuzz) -> None:
        super().__init__(application)
        self._fuzz = fuzz

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        answer = super().request(method, path, **options)
        self._fuzz.case(PART, f"{method} {path}", answer.status_code)
        return answer


@pytest.fixture
def world(
    application: FastAPI,
    app: AppContext,
    study_shelf: StudyShelf,
    clock: Clock,
    background: Background,
    fuzz: Fuzz,
) -> Iterator[World]:
    """The study, over this test's database, and how its server starts again."""
    study_shelf.put_into(app, PLAN + FROM_PROLIFIC)
    api_token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    opened = [app]

    def restart() -> AppContext:
        opened[-1].close()
        again = open_app(app.settings, now=clock.now, seed=count(1).__next__, background=background)
        opened.append(again)
        application.state.app = again
        return again

    with Counted(application, fuzz) as client:
        yield World(client, clock, api_token, restart)
    opened[-1].close()


def test_what_is_stored_is_what_two_people_did(world: World, fuzz: Fuzz) -> None:
    class Here(Passage):
        def __init__(self) -> None:
            super().__init__(world)

    def one_round(seed: int) -> None:
        run_state_machine_as_test(
            seeded(seed)(Here) if fuzz.seconds else Here,
            settings=fuzz.settings(3, stateful_step_count=30),
        )

    fuzz.rounds(PART, one_round)
