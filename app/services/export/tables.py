"""All exported tables, and the data dictionary made from their descriptions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from sqlalchemy.orm import Session

from app.study.plan import Plan

from .consents import CONSENTS
from .evidence import PLAYBACK
from .faults_checks import CHECKS, FAULTS, UNDONE
from .people import DELETIONS, IDENTITIES, PARTICIPANTS, QUESTIONNAIRES, SESSIONS
from .pooled_people import PEOPLE, POPULATION
from .queries import ACQUIRED, EVENTS, PREFERENCES, QUERIES
from .recordings import RECORDINGS
from .rollouts import ROLLOUTS
from .table import Column, Request, Row, Table, text
from .trials import TRIALS, with_condition


def _dictionary_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        text("file", "File that the column is in."),
        text("column", "Name of the column."),
        text("type", "string, integer, number, boolean (true or false) or datetime."),
        text("unit", "Unit of the values, where they have one."),
        text("description", "What the column holds."),
    )


def dictionary_of(tables: Iterable[Table]) -> Table:
    """The data dictionary of these tables."""

    def rows(_session: Session, request: Request) -> Iterator[Row]:
        return _described(tables, request)

    return Table(DATA_DICTIONARY.name, DATA_DICTIONARY.description, _dictionary_columns, rows)


def _dictionary_rows(_session: Session, request: Request) -> Iterator[Row]:
    return _described(TABLES.values(), request)


def _described(tables: Iterable[Table], request: Request) -> Iterator[Row]:
    for table in tables:
        for column in table.columns(request.study.plan):
            yield (
                f"{table.name}.csv",
                column.name,
                column.type,
                column.unit,
                column.description,
            )


DATA_DICTIONARY = Table(
    "data_dictionary", "Every column of every file.", _dictionary_columns, _dictionary_rows
)

#: The tables of the zip: all except the identities.
ZIPPED = (
    QUERIES,
    TRIALS,
    with_condition(PREFERENCES),
    with_condition(ACQUIRED),
    SESSIONS,
    CONSENTS,
    PARTICIPANTS,
    with_condition(QUESTIONNAIRES, has_practice=False),
    DELETIONS,
    with_condition(EVENTS),
    with_condition(PLAYBACK),
    with_condition(CHECKS),
    with_condition(UNDONE),
    with_condition(FAULTS),
    RECORDINGS,
    ROLLOUTS,
    PEOPLE,
    POPULATION,
    DATA_DICTIONARY,
)

#: The tables of one person's data: all that say something of them, and what explains them.
PERSONAL = (
    *(table for table in ZIPPED if table not in (DELETIONS, ROLLOUTS, DATA_DICTIONARY)),
    IDENTITIES,
)

#: All tables by name.
TABLES: Mapping[str, Table] = {table.name: table for table in (*ZIPPED, IDENTITIES)}
