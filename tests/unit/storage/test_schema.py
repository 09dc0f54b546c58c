"""The schema that migrations build is the one that the models describe."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import CheckConstraint, inspect, text
from sqlalchemy.exc import DatabaseError

from app.storage.database import Database
from app.storage.models.studies import Base
from app.storage.schema import migrate
from tests.databases import Databases


@pytest.fixture
def database(databases: Databases, tmp_path: Path) -> Iterator[Database]:
    """At the newest schema, to which it came by migration."""
    database = Database(databases.new(tmp_path))
    yield database
    database.close()


def test_nothing_is_left_to_migrate(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


def test_the_checks_are_those_of_the_models(database: Database) -> None:
    found = inspect(database.engine)
    for table in Base.metadata.sorted_tables:
        described = {
            str(check.name): _plain(str(check.sqltext))
            for check in table.constraints
            if isinstance(check, CheckConstraint)
        }
        built = {
            str(check["name"]): _plain(check["sqltext"])
            for check in found.get_check_constraints(table.name)
        }
        assert built.keys() == described.keys(), table.name
        # PostgreSQL says in words of its own what was asked of it.
        assert not database.is_sqlite or built == described, table.name


def test_every_constraint_has_a_name(database: Database) -> None:
    found = inspect(database.engine)
    for table in found.get_table_names():
        if table == "alembic_version":
            continue
        constraints = [*found.get_unique_constraints(table), *found.get_foreign_keys(table)]
        assert all(constraint["name"] for constraint in constraints), table


@pytest.mark.sqlite
def test_migrating_again_changes_nothing(databases: Databases, tmp_path: Path) -> None:
    url = databases.new(tmp_path)
    before = (tmp_path / "pbpo.sqlite3").read_bytes()
    migrate(url)
    assert (tmp_path / "pbpo.sqlite3").read_bytes() == before


def _plain(sql: str) -> str:
    return " ".join(sql.split())


@pytest.mark.parametrize(
    "change", ["UPDATE audit_events SET actor = 'nobody'", "DELETE FROM audit_events"]
)
def test_the_audit_trail_is_only_added_to(database: Database, change: str) -> None:
    with database.write() as db:
        db.execute(
            text("INSERT INTO audit_events VALUES (1, '2026-01-01', 'ada', 'opened', NULL, '{}')")
        )
    # PostgreSQL's trigger does not say of which kind its refusal is.
    refused = pytest.raises(DatabaseError, match="append-only")
    with refused, database.write() as db:
        db.execute(text(change))
