"""Whoever reads sees one moment of the database, whatever others write meanwhile."""

from __future__ import annotations

from sqlalchemy import func, select

from app.services import accounts
from app.services.accounts import Role
from app.services.studio import Studio
from app.storage.accounts import Account
from app.storage.database import Database


def add_account(studio: Studio, name: str) -> None:
    accounts.create(studio, f"{name}@lab.example", "correct horse battery", Role.EXPERIMENTER)


def test_a_reader_sees_nothing_of_what_is_written_meanwhile(studio: Studio) -> None:
    add_account(studio, "first")
    other = Database(studio.settings.url)
    count = select(func.count(Account.id))
    with other.read() as session:
        assert session.scalar(count) == 1
        add_account(studio, "second")
        # As the second table of an export would.
        assert session.scalar(count) == 1
    with other.read() as session:
        assert session.scalar(count) == 2
    other.close()
