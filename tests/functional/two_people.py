"""A study that two people have been in: one to the end, hastily; one a day later, for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import FROM_PROLIFIC, Clock, StudyShelf
from tests.databases import Databases

from .client import Api, by_turns
from .conftest import EMAIL, LEARNING_PLAN, PASSWORD

DAY_S = 24 * 3600


@dataclass
class TwoPeople:
    """Walked once for all tests of a module; each test finds what was stored."""

    kept: Any = None
    api_token: str = ""
    #: Of the second person: deletes what they gave.
    second_token: str = ""

    def put_into(
        self, app: AppContext, client: Api, databases: Databases, shelf: StudyShelf, clock: Clock
    ) -> StudyInfo:
        if self.kept:
            databases.put_into(app.settings.url, self.kept)
        else:
            shelf.put_into(app, LEARNING_PLAN + FROM_PROLIFIC)
            account = accounts.create(app, EMAIL, PASSWORD)
            self.api_token = accounts.create_api_token(app, account, "tests")
            first = client.start(external_ids={"PROLIFIC_PID": "first"}).to_first_query()
            assert first.respond("left", rt_ms=1000, replays=2).status_code == 200
            first.to_the_end(by_turns("skip", "left", "right", "skip", "left"), clock.forward)
            clock.forward(DAY_S)
            second = client.start(external_ids={"PROLIFIC_PID": "second"}).to_first_query()
            for response in ("right", "left", "left"):
                assert second.respond(response, rt_ms=4000, replays=1).status_code == 200
            self.second_token = second.token
            self.kept = databases.keep(app.settings.url)
        return repository.find(app, "short")
