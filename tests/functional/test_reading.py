"""Whoever reads sees one moment of the database, whatever others write meanwhile."""

from __future__ import annotations

from sqlalchemy import func, select

from app.services.accounts import accounts
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.storage.database import Database
from app.storage.models.accounts import Account


def add_account(app: AppContext, name: str) -> None:
    accounts.create(app, f"{name}@lab.example", "correct horse battery", Role.EXPERIMENTER)


def test_a_reader_sees_nothing_of_what_is_written_meanwhile(app: AppContext) -> None:
    add_account(app, "first")
    other = Database(app.settings.url)
    count = select(func.count(Account.id))
    with other.read() as db:
        assert db.scalar(count) == 1
        add_account(app, "second")
        # As the second table of an export would.
        assert db.scalar(count) == 1
    with other.read() as db:
        assert db.scalar(count) == 2
    other.close()
