"""The data inventory: for each stored field its purpose, retention period, and who can see it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, dataclass

from app.storage.models import accounts, arrivals, records, server_secrets
from app.storage.models.studies import Base
from app.study.plan import Plan

from .column_purposes import STORED, DataSubject

#: Imported so that their tables are registered in `Base.metadata`.
_MODULES = (accounts, arrivals, records, server_secrets)

_RUN = "those who run the study (its owner, whom it is shared with, admins)"
_SEEN_BY = {
    DataSubject.ANSWERS: _RUN,
    DataSubject.IDENTITIES: (
        f"{_RUN}, only when asked for by name, and each time noted in the trail"
    ),
    DataSubject.COUNT: _RUN,
    DataSubject.STUDY: "those who run the study, and reviewers",
    DataSubject.SERVER: "nobody: neither a page nor an export shows it",
    DataSubject.STAFF: "admins; of the trail, what concerns the study also those who run it",
}


@dataclass(frozen=True)
class Field:
    """One stored field of the inventory."""

    table: str
    field: str
    about: str
    purpose: str
    retention_period: str
    seen_by: str


def fields(plan: Plan) -> list[Field]:
    """All fields of all tables, those about participants first."""
    order = list(STORED)
    tables = sorted(Base.metadata.sorted_tables, key=lambda table: order.index(table.name))
    return [
        Field(
            table.name,
            column.name,
            STORED[table.name].subject.value,
            STORED[table.name].purposes[column.name],
            retention_period(plan, STORED[table.name].subject),
            _SEEN_BY[STORED[table.name].subject],
        )
        for table in tables
        for column in table.columns
    ]


def retention_period(plan: Plan, subject: DataSubject) -> str:
    """The retention period of data with this subject, in words."""
    rule = plan.retention
    match subject:
        case DataSubject.ANSWERS:
            return _days(rule.everything_days)
        case DataSubject.IDENTITIES:
            return _days(rule.identities_kept_for)
        case DataSubject.COUNT | DataSubject.STUDY:
            return "as long as the study"
        case DataSubject.SERVER:
            return "as long as the database"
        case DataSubject.STAFF:
            return "as long as the account; the trail for good"


def as_csv(found: Iterable[Field]) -> bytes:
    """The inventory as CSV in UTF-8."""
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["table", "field", "about", "purpose", "kept", "seen_by"])
    rows.writerows(astuple(field) for field in found)
    return text.getvalue().encode("utf-8")


def _days(days: int | None) -> str:
    if days is None:
        return "until those who run the study or the person delete it"
    return f"{days} days after the session has ended, or earlier at the person's wish"
