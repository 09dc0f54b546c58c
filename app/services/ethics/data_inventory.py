"""The list of all that is stored: for each field its purpose, for how long, and who can see it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, dataclass

from app.storage.models import accounts, arrivals, records, server_secrets
from app.storage.models.studies import Base
from app.study.plan import Plan

from .column_purposes import STORED, Whose

#: They fill the same list of tables as `app.storage.tables`.
_MODULES = (accounts, arrivals, records, server_secrets)

_RUN = "those who run the study (its owner, whom it is shared with, admins)"
_SEEN_BY = {
    Whose.ANSWERS: _RUN,
    Whose.IDENTITIES: f"{_RUN}, only when asked for by name, and each time noted in the trail",
    Whose.COUNT: _RUN,
    Whose.STUDY: "those who run the study, and reviewers",
    Whose.SERVER: "nobody: neither a page nor an export shows it",
    Whose.STAFF: "admins; of the trail, what concerns the study also those who run it",
}


@dataclass(frozen=True)
class Field:
    """One stored field."""

    table: str
    field: str
    about: str
    purpose: str
    kept: str
    seen_by: str


def fields(plan: Plan) -> list[Field]:
    """Every field of every table, those about participants first."""
    order = list(STORED)
    tables = sorted(Base.metadata.sorted_tables, key=lambda table: order.index(table.name))
    return [
        Field(
            table.name,
            column.name,
            STORED[table.name].whose.value,
            STORED[table.name].purposes[column.name],
            kept(plan, STORED[table.name].whose),
            _SEEN_BY[STORED[table.name].whose],
        )
        for table in tables
        for column in table.columns
    ]


def kept(plan: Plan, whose: Whose) -> str:
    """For how long what is about these is kept, in words."""
    rule = plan.retention
    match whose:
        case Whose.ANSWERS:
            return _days(rule.everything_days)
        case Whose.IDENTITIES:
            return _days(rule.identities_kept_for)
        case Whose.COUNT | Whose.STUDY:
            return "as long as the study"
        case Whose.SERVER:
            return "as long as the database"
        case Whose.STAFF:
            return "as long as the account; the trail for good"


def as_csv(found: Iterable[Field]) -> bytes:
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["table", "field", "about", "purpose", "kept", "seen_by"])
    rows.writerows(astuple(field) for field in found)
    return text.getvalue().encode("utf-8")


def _days(days: int | None) -> str:
    if days is None:
        return "until those who run the study or the person delete it"
    return f"{days} days after the session has ended, or earlier at the person's wish"
