"""The audit trail: what those who run studies did, only ever added to.

It names nobody who took part but by pseudonym.
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

#: Who acts where no account does.
COMMAND_LINE = "command line"
RETENTION_RULE = "retention rule"
NOBODY = "not signed in"


@dataclass(frozen=True)
class AuditLine:
    """One thing that was done; the later, the larger its id."""

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
    """Add to the trail within the transaction that does what it tells of."""
    db.add(
        AuditEvent(
            happened_at=at, actor=actor, action=action, study_slug=study_slug, details=details
        )
    )


def note_alone(
    app: AppContext, actor: str, action: str, study_slug: str | None = None, **details: Any
) -> None:
    """Add to the trail what needs no transaction of its own: a look, an export."""
    with app.database.write() as db:
        note(db, app.now(), actor, action, study_slug, **details)


def trail(
    app: AppContext,
    study_slug: str | None = None,
    actions: Sequence[str] | None = None,
    limit: int = 200,
    before: int | None = None,
) -> list[AuditLine]:
    """The newest entries first; of one study, of certain actions, before an id, if asked for."""
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
