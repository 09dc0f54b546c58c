"""Runs the migrations, which are the only way the schema is created."""

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
    """Alembic's configuration for this database."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    config.set_main_option("path_separator", "os")
    config.attributes["url"] = url
    return config


def migrate(url: str, revision: str = "head") -> None:
    """Upgrade the database to `revision`."""
    command.upgrade(configuration(url), revision)


def bring_to_newest(database: Database) -> None:
    """Upgrade an open database to the newest revision, unless it is there already."""
    with database.engine.connect() as connection:
        if revision_of(connection) == newest_revision():
            return
    migrate(database.url)


@cache
def newest_revision() -> str:
    """The newest revision in the migrations folder."""
    head = ScriptDirectory(str(MIGRATIONS)).get_current_head()
    assert head is not None
    return head


def revision_of(connection: Connection) -> str | None:
    """The revision of a database; None if it was never migrated."""
    return MigrationContext.configure(connection).get_current_revision()
