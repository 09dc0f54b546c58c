"""Databases that former versions have written are brought to the newest schema without loss."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pandas as pd
import pytest

from app.main import create_app
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.sessions import replay
from app.services.studies import repository
from app.storage.schema import MIGRATIONS
from tests.conftest import Clock, Idle

from .client import Api, Session, by_turns

FIXTURES = Path(__file__).parents[1] / "fixtures"
FOLDERS = sorted(FIXTURES.glob("schema_*"))

pytestmark = pytest.mark.sqlite


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def fixture(request: pytest.FixtureRequest) -> Path:
    """What the code of one version has written."""
    folder: Path = request.param
    return folder


@pytest.fixture
def known(fixture: Path) -> dict[str, str]:
    """The tokens of the session that stands half-way and of the experimenter, and its query."""
    found: dict[str, str] = json.loads((fixture / "known.json").read_text("utf-8"))
    return found


@pytest.fixture
def database(fixture: Path, tmp_path: Path) -> Path:
    """A database file as that version left it."""
    path = tmp_path / "data" / "pbpo.sqlite3"
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript((fixture / "database.sql").read_text("utf-8"))
        found = connection.execute("SELECT version_num FROM alembic_version").fetchall()
    assert found == [(fixture.name.removeprefix("schema_"),)]
    return path


@pytest.fixture
def rows(database: Path) -> dict[str, int]:
    """How many rows each of its tables had."""
    with closing(sqlite3.connect(database)) as connection:
        return count_rows(connection)


@pytest.fixture
def upgraded(rows: dict[str, int], settings: Settings) -> Iterator[AppContext]:
    """The studio that the present code makes of it, some minutes later."""
    clock = Clock()
    clock.forward(300)
    app = open_app(settings, now=clock.now, background=Idle(1))
    yield app
    app.close()


@pytest.fixture
def client(upgraded: AppContext) -> Iterator[Api]:
    with Api(create_app(app=upgraded)) as api:
        yield api


def count_rows(connection: sqlite3.Connection) -> dict[str, int]:
    names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    return {
        name: connection.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]
        for (name,) in names
        if name != "sqlite_sequence"
    }


def test_every_schema_has_a_database_of_its_time() -> None:
    """One that is missing is made while the code still has that schema: tests/fixtures/README.md"""
    schemas = {path.name.partition("_")[0] for path in (MIGRATIONS / "versions").glob("[0-9]*.py")}
    assert {folder.name.removeprefix("schema_") for folder in FOLDERS} == schemas


def test_every_row_is_still_there(
    rows: dict[str, int], upgraded: AppContext, database: Path
) -> None:
    assert rows["responses"] == 9
    with closing(sqlite3.connect(database)) as connection:
        now = count_rows(connection)
        assert {name: now[name] for name in rows} == rows
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        # What there was no word for at first: the first account could do everything, tokens could
        # write, and all that was deleted was deleted at somebody's wish.
        assert connection.execute("SELECT role FROM accounts").fetchall() == [("admin",)]
        assert connection.execute("SELECT scope FROM api_tokens").fetchall() == [("write",)]
        assert connection.execute("SELECT reason FROM tombstones").fetchall() == [("wish",)]
        assert connection.execute("SELECT conditions_off FROM studies").fetchall() == [("[]",)]


def test_every_export_says_what_the_former_version_said(
    client: Api, fixture: Path, known: dict[str, str]
) -> None:
    tables = sorted(fixture.glob("*.csv"))
    assert len(tables) >= 11
    for path in tables:
        answer = client.get(
            f"/api/v1/studies/kettles/export/{path.name}",
            headers={"Authorization": f"Bearer {known['experimenter']}"},
        )
        assert answer.status_code == 200, path.name
        now = pd.read_csv(io.BytesIO(answer.content), dtype=str, keep_default_na=False)
        before = pd.read_csv(path, dtype=str, keep_default_na=False)
        # There may be more columns now; those of then say what they said.
        pd.testing.assert_frame_equal(now[list(before.columns)], before, obj=path.name)


def test_every_query_is_worked_out_again_as_it_was_stored(upgraded: AppContext) -> None:
    trials = list(replay.replay(upgraded, "kettles"))
    assert len(trials) == 3
    assert [trial.differences for trial in trials if trial.differences] == []


def test_who_was_half_way_goes_on_to_the_end(client: Api, known: dict[str, str]) -> None:
    db = Session(client, known["session"], {})
    assert db.look()["query"]["id"] == known["query"]
    assert db.state["progress"]["query"] == 2
    pressed = db.to_the_end(by_turns("left"), lambda _: None)
    assert len(pressed) == 7
    assert db.state["stage"] == "completed"


def test_it_takes_new_people(client: Api, upgraded: AppContext) -> None:
    assert repository.find(upgraded, "kettles").status == "open"
    assert client.start("kettles").to_first_query().respond("left").status_code == 200
