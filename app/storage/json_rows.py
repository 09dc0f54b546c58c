"""Rows that are read as one: as a list of lists, in JSON.

SQLite's driver lets go of the interpreter at every row, and on a busy server waits each time to
have it back; PostgreSQL's describes every column anew. Both make one value of one row quickly.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session


class AsOneRow:
    """A statement whose rows are of numbers and texts alone. In no order."""

    def __init__(self, statement: Select[Any]) -> None:
        columns = statement.subquery().c
        self._on_sqlite = select(func.json_group_array(func.json_array(*columns)))
        self._on_postgresql = select(func.json_agg(func.json_build_array(*columns)))

    def read(self, db: Session, parameters: Mapping[str, Any]) -> Sequence[Sequence[Any]]:
        """All rows, each with its columns in the statement's order."""
        rows: list[list[Any]]
        if db.get_bind().dialect.name == "sqlite":
            rows = json.loads(db.scalar(self._on_sqlite, parameters) or "[]")
        else:
            rows = db.scalar(self._on_postgresql, parameters) or []
        return rows
