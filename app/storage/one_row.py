"""Rows that are read as one.

SQLite's driver lets go of the interpreter at every row, and on a busy server waits each time to
have it back. There, all rows come as one: as a text.
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
        self._rows = statement
        rows = statement.subquery()
        self._text = select(func.json_group_array(func.json_array(*rows.c)))

    def read(self, session: Session, parameters: Mapping[str, Any]) -> Sequence[Sequence[Any]]:
        """All rows, each with its columns in the statement's order."""
        if session.get_bind().dialect.name != "sqlite":
            return session.execute(self._rows, parameters).all()
        rows: list[list[Any]] = json.loads(session.scalar(self._text, parameters) or "[]")
        return rows
