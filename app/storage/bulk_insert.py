"""Bulk insert without ORM objects, several times faster than adding objects to a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from sqlalchemy import Table
from sqlalchemy.orm import Session

from app.storage.models.studies import Base


def insert_rows(db: Session, of: type[Base], rows: Sequence[Mapping[str, Any]]) -> None:
    """Insert rows immediately. rows: values by column name. ORM objects are not updated."""
    if rows:
        # inline: do not fetch the primary keys. A single row needs no executemany.
        insert = cast(Table, of.__table__).insert().inline()
        db.execute(insert, rows[0] if len(rows) == 1 else rows)
