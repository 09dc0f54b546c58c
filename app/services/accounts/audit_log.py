"""The audit log: an append-only table of what the people who run studies did.

Participants appear in it by pseudonym only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.storage.models.records import AuditEvent

#: Actors that are not accounts.
COMMAND_LINE = "command line"
RETENTION_RULE = "retention rule"
NOT_SIGNED_IN = "not signed in"


@dataclass(frozen=True)
class AuditLine:
    """One entry. Later entries have larger ids."""

    id: int
    happened_at: datetime
    actor: str
    action: str
    study_slug: str | None
    details: dict[str, Any]


def note(
    db: Session,
    at: datetime,
    actor: str,
    action: str,
    study_slug: str | None = None,
    **details: Any,
) -> None:
    """Append an entry within the transaction that makes the change it records."""
    db.add(
        AuditEvent(
            happened_at=at, actor=actor, action=action, study_slug=study_slug, details=details
        )
    )


def note_alone(
    app: AppContext, actor: str, action: str, study_slug: str | None = None, **details: Any
) -> None:
    """Append an entry in a transaction of its own, for acts that change nothing else."""
    with app.database.write() as db:
        note(db, app.now(), actor, action, study_slug, **details)


def trail(
    app: AppContext,
    study_slug: str | None = None,
    actions: Sequence[str] | None = None,
    limit: int = 200,
    before: int | None = None,
) -> list[AuditLine]:
    """Entries, the newest first.

    study_slug, actions: only those of this study or with these actions. limit: how many at most.
    before: only entries with a smaller id.
    """
    statement = select(AuditEvent).order_by(AuditEvent.id.desc()).limit(limit)
    if study_slug is not None:
        statement = statement.where(AuditEvent.study_slug == study_slug)
    if actions is not None:
        statement = statement.where(AuditEvent.action.in_(actions))
    if before is not None:
        statement = statement.where(AuditEvent.id < before)
    with app.database.read() as db:
        return [
            AuditLine(row.id, row.happened_at, row.actor, row.action, row.study_slug, row.details)
            for row in db.scalars(statement)
        ]
