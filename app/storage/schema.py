"""The schema is built by migration, and only so."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection

from .database import Database

MIGRATIONS = Path(__file__).resolve().parents[2] / "migrations"


def configuration(url: str) -> Config:
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    config.set_main_option("path_separator", "os")
    config.attributes["url"] = url
    return config


def migrate(url: str, revision: str = "head") -> None:
    """Bring the database to `revision`; nothing happens if it is there already."""
    command.upgrade(configuration(url), revision)


def bring_to_newest(database: Database) -> None:
    """As `migrate`, for who has the database open: most often there is nothing to do."""
    with database.engine.connect() as connection:
        if revision_of(connection) == newest_revision():
            return
    migrate(database.url)


@cache
def newest_revision() -> str:
    """The revision that this code was written for."""
    head = ScriptDirectory(str(MIGRATIONS)).get_current_head()
    assert head is not None
    return head


def revision_of(connection: Connection) -> str | None:
    """The revision that a database is at; None if it was never migrated."""
    return MigrationContext.configure(connection).get_current_revision()
