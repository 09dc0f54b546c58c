"""How Alembic reaches the database: through the URL or connection that the caller hands over."""

from __future__ import annotations

from typing import Any

from alembic import context
from sqlalchemy import event, text

from app.storage.advisory_lock import AdvisoryLock
from app.storage.database import Database
from app.storage.models import (
    accounts,
    arrivals,
    consents,
    records,
    rollouts,
    server_secrets,
    studies,
)

# All modules fill the same metadata.
for _table in (
    accounts.Account,
    arrivals.Reentry,
    consents.ConsentRow,
    records.AuditEvent,
    rollouts.Rollout,
    server_secrets.ServerSecret,
):
    assert _table.metadata is studies.Base.metadata


def run() -> None:
    database = Database(context.config.attributes["url"])
    if database.is_sqlite:
        # To alter a table, SQLite's is copied and dropped, and a drop deletes row by row: what
        # hangs on those rows would go too. The setting holds only outside a transaction.
        event.listen(database.engine, "connect", _without_cascades)
    try:
        with database.engine.connect() as connection:
            if not database.is_sqlite:
                # Several servers may start at once: the others wait, and find it done. The lock goes
                # with the connection.
                connection.execute(
                    text("SELECT pg_advisory_lock(:what)"), {"what": AdvisoryLock.MIGRATION}
                )
                connection.commit()
            context.configure(
                connection=connection,
                target_metadata=studies.Base.metadata,
                # SQLite cannot alter a table in place: Alembic copies it.
                render_as_batch=database.is_sqlite,
                transaction_per_migration=True,
            )
            with context.begin_transaction():
                context.run_migrations()
    finally:
        database.close()


def _without_cascades(connection: Any, _record: Any) -> None:
    connection.execute("PRAGMA foreign_keys = OFF")


run()
