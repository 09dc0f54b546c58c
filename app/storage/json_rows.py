"""Reads all rows of a statement as one JSON value.

SQLite's driver releases the interpreter lock at every row and, on a busy server, waits each time to
get it back; PostgreSQL's driver describes every column of a result. One row with one value is
faster with both.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session


class AsOneRow:
    """A statement whose columns are all numbers or texts. The order of its rows is undefined."""

    def __init__(self, statement: Select[Any]) -> None:
        columns = statement.subquery().c
        self._on_sqlite = select(func.json_group_array(func.json_array(*columns)))
        self._on_postgresql = select(func.json_agg(func.json_build_array(*columns)))

    def read(self, db: Session, parameters: Mapping[str, Any]) -> Sequence[Sequence[Any]]:
        """Execute the statement, and return its rows with the columns in the statement's order."""
        rows: list[list[Any]]
        if db.get_bind().dialect.name == "sqlite":
            rows = json.loads(db.scalar(self._on_sqlite, parameters) or "[]")
        else:
            rows = db.scalar(self._on_postgresql, parameters) or []
        return rows
