"""A database returns rows in whatever order suits it, unless it is told: nobody sees which."""

from __future__ import annotations

import re
from typing import Any

from sqlalchemy import event

from app.services import export
from app.services.accounts import accounts
from app.services.context import AppContext
from tests.conftest import Clock, StudyShelf
from tests.databases import Databases

from .client import Api
from .desk import Desk
from .two_people import TwoPeople

STUDY = "/studies/short"
#: What was downloaded is told on others.
PAGES = (STUDY, *(f"{STUDY}/{page}" for page in ("plan", "live", "results", "people", "manage")))
TABLES = (*export.ZIPPED, export.TABLES["identities"])
FILES = (
    *(f"export/{table.name}.csv" for table in TABLES),
    "export.zip?format=psych-ds",
    "export.zip?format=botorch",
    "report.html",
)
#: Where no order was asked for, SQLite begins at the other end; PostgreSQL goes other ways.
OTHERWISE = {
    "sqlite": "PRAGMA reverse_unordered_selects = ON",
    "postgresql": "SET enable_sort = off; SET enable_nestloop = off",
}


def test_pages_and_files_are_the_same_whichever_rows_come_first(
    app: AppContext, client: Api, databases: Databases, study_shelf: StudyShelf, clock: Clock
) -> None:
    people = TwoPeople()
    people.put_into(app, client, databases, study_shelf, clock)
    desk = Desk(client, app, "admin@lab.example", accounts.Role.ADMIN)
    headers = {"Authorization": f"Bearer {people.api_token}"}

    def everything() -> dict[str, bytes]:
        found = {page: desk.get(page) for page in PAGES}
        shown = "".join(page.text for page in found.values())
        links = set(re.findall(rf'"({STUDY}/(?:sessions/[^"]+|figures/[^"]+\.json[^"]*))"', shown))
        assert len(links) > 8
        found |= {link: desk.get(link) for link in sorted(links)}
        for file in FILES:
            found[file] = client.get(f"/api/v1/studies/short/{file}", headers=headers)
        assert {answer.status_code for answer in found.values()} == {200}
        return {where: answer.content for where, answer in found.items()}

    def go_otherwise(connection: Any, *_: Any) -> None:
        connection.execute(OTHERWISE[app.database.engine.name]).close()
        connection.commit()

    before = everything()
    event.listen(app.database.engine, "checkout", go_otherwise)
    after = everything()
    assert [where for where in before if before[where] != after[where]] == []
