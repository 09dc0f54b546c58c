"""Replaces clock times in tables by dates and relative times, for formats that are published.

Platforms list the start time of each submission. A published time to the second could be joined
with that list, which would identify participants even after their ids were deleted. Starts of
sessions and participants are therefore reduced to the day, and all other times become seconds since
the session began.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.studies import SessionRow
from app.study.plan import Plan

from .cells import Value
from .table import SESSION, Column, Request, Row, Table, fetch, number, of_sessions, text

_TIME = "datetime"
#: Columns that become dates: starts of sessions, and times that belong to no session.
_DAYS = ("started_at", "created_at", "deleted_on")


def without_clock_times(table: Table) -> Table:
    """The table with its times replaced by dates or by seconds since the session began."""

    def columns(plan: Plan) -> tuple[Column, ...]:
        return tuple(_column(column) for column in table.columns(plan))

    def rows(db: Session, request: Request) -> Iterator[Row]:
        before = table.columns(request.study.plan)
        if all(column.type != _TIME for column in before):
            yield from table.rows(db, request)
            return
        names = [column.name for column in before]
        at = names.index(SESSION.name) if SESSION.name in names else None
        begun = _beginnings(db, request) if at is not None else {}
        for row in table.rows(db, request):
            start = begun[str(row[at])] if at is not None else None
            yield tuple(
                _relative(column, value, start) for column, value in zip(before, row, strict=True)
            )

    return Table(table.name, table.description, columns, rows)


def _column(column: Column) -> Column:
    if column.type != _TIME:
        return column
    stem = column.name.removesuffix("_at").removesuffix("_on")
    if column.name in _DAYS:
        return text(f"{stem}_on", f"{column.description} The day alone, in UTC.")
    said = f"{column.description} In seconds since the session began."
    return number(f"{stem}_after_s", said, "s")


def _relative(column: Column, value: Value, start: datetime | None) -> Value:
    if not isinstance(value, datetime):
        return value
    if column.name in _DAYS or start is None:
        return value.date().isoformat()
    return round((value - start).total_seconds(), 3)


def _beginnings(db: Session, request: Request) -> dict[str, datetime]:
    statement = of_sessions(select(SessionRow.public_id, SessionRow.started_at), request)
    return {row.public_id: row.started_at for row in fetch(db, statement)}
