"""Databases that former versions have written are brought to the newest schema without loss."""

from __future__ import annotations

import io
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pandas as pd
import pytest

from app.main import create_app
from app.services import replay, studies
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from tests.conftest import Clock, Idle

from .client import Api, Session, by_turns

FIXTURES = Path(__file__).parents[1] / "fixtures"
#: Of the session that stands half-way, and of the experimenter, in schema_0001.
SESSION_TOKEN = "GRCcugZkU99RJOeyAXOsjKq9fOG0BpQwI7cwbQYacnk"
OPEN_QUERY = "MEYsoKy85jk1wsEQjdMJPA"
API_TOKEN = "SEVUrh2DvLfQDUaB-Rts3xoRB3ZKmmGMcy7vgVvWt_8"

pytestmark = pytest.mark.sqlite


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A database file as the first version left it."""
    path = tmp_path / "data" / "pbpo.sqlite3"
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript((FIXTURES / "schema_0001" / "database.sql").read_text("utf-8"))
    return path


@pytest.fixture
def rows(database: Path) -> dict[str, int]:
    """How many rows each of its tables had."""
    with closing(sqlite3.connect(database)) as connection:
        return count_rows(connection)


@pytest.fixture
def upgraded(rows: dict[str, int], settings: Settings) -> Iterator[Studio]:
    """The studio that the present code makes of it, some minutes later."""
    clock = Clock()
    clock.forward(300)
    studio = open_studio(settings, now=clock.now, background=Idle(1))
    yield studio
    studio.close()


@pytest.fixture
def client(upgraded: Studio) -> Iterator[Api]:
    with Api(create_app(studio=upgraded)) as api:
        yield api


def count_rows(connection: sqlite3.Connection) -> dict[str, int]:
    names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    return {
        name: connection.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]
        for (name,) in names
        if name != "sqlite_sequence"
    }


def test_every_row_is_still_there(rows: dict[str, int], upgraded: Studio, database: Path) -> None:
    assert rows["responses"] == 9
    with closing(sqlite3.connect(database)) as connection:
        now = count_rows(connection)
        assert {name: now[name] for name in rows} == rows
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        # What there was no word for then: the first account could do everything, tokens could
        # write, and all that was deleted was deleted at somebody's wish.
        assert connection.execute("SELECT role FROM accounts").fetchall() == [("admin",)]
        assert connection.execute("SELECT scope FROM api_tokens").fetchall() == [("write",)]
        assert connection.execute("SELECT reason FROM tombstones").fetchall() == [("wish",)]
        assert connection.execute("SELECT conditions_off FROM studies").fetchall() == [("[]",)]


@pytest.mark.parametrize(
    "table", sorted(path.stem for path in (FIXTURES / "schema_0001").glob("*.csv"))
)
def test_every_export_says_what_the_former_version_said(client: Api, table: str) -> None:
    answer = client.get(
        f"/api/v1/studies/kettles/export/{table}.csv",
        headers={"Authorization": f"Bearer {API_TOKEN}"},
    )
    assert answer.status_code == 200
    now = pd.read_csv(io.BytesIO(answer.content), dtype=str, keep_default_na=False)
    before = pd.read_csv(
        FIXTURES / "schema_0001" / f"{table}.csv", dtype=str, keep_default_na=False
    )
    # There may be more columns now; those of then say what they said.
    pd.testing.assert_frame_equal(now[list(before.columns)], before)


def test_every_query_is_worked_out_again_as_it_was_stored(upgraded: Studio) -> None:
    trials = list(replay.replay(upgraded, "kettles"))
    assert len(trials) == 3
    assert [trial.differences for trial in trials if trial.differences] == []


def test_who_was_half_way_goes_on_to_the_end(client: Api, upgraded: Studio) -> None:
    session = Session(client, SESSION_TOKEN, {})
    assert session.look()["query"]["id"] == OPEN_QUERY
    assert session.state["progress"]["query"] == 2
    pressed = session.to_the_end(by_turns("left"), lambda _: None)
    assert len(pressed) == 7
    assert session.state["stage"] == "completed"


def test_it_takes_new_people(client: Api, upgraded: Studio) -> None:
    assert studies.find(upgraded, "kettles").status == "open"
    assert client.start("kettles").to_first_query().respond("left").status_code == 200
