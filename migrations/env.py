"""How Alembic reaches the database: through the URL or connection that the caller hands over."""

from __future__ import annotations

from alembic import context

from app.storage import accounts, arrivals, tables
from app.storage.database import Database

# All three modules fill the same metadata.
assert accounts.Account.metadata is arrivals.Reentry.metadata is tables.Base.metadata


def run() -> None:
    database = Database(context.config.attributes["url"])
    try:
        with database.engine.connect() as connection:
            context.configure(
                connection=connection,
                target_metadata=tables.Base.metadata,
                # SQLite cannot alter a table in place: Alembic copies it.
                render_as_batch=database.is_sqlite,
                transaction_per_migration=True,
            )
            with context.begin_transaction():
                context.run_migrations()
    finally:
        database.close()


run()
