"""Lookup of a study's participants by pseudonym, for requests to delete their data."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import func, select

from app.services.context import AppContext
from app.services.runtime.errors import NotFoundError
from app.storage.models.studies import Participant, SessionRow


@dataclass(frozen=True)
class Person:
    """One participant. mode: that of their sessions, which all have the same mode."""

    pseudonym: str
    sessions: int
    mode: str
    created_at: datetime


def newest(app: AppContext, study_id: int, limit: int) -> list[Person]:
    """The newest participants of a study, at most `limit`."""
    return _found(app, study_id, limit=limit)


def count(app: AppContext, study_id: int) -> int:
    """The number of participants of a study."""
    statement = select(func.count(Participant.id)).where(Participant.study_id == study_id)
    with app.database.read() as db:
        return db.scalar(statement) or 0


def find(app: AppContext, study_id: int, pseudonym: str) -> Person:
    """The participant with this pseudonym; case and white space do not matter.

    Raises NotFoundError.
    """
    found = _found(app, study_id, pseudonym.strip().upper())
    if not found:
        raise NotFoundError(f"expected a participant of this study, and {pseudonym[:24]!r} is none")
    return found[0]


def _found(
    app: AppContext, study_id: int, pseudonym: str | None = None, limit: int | None = None
) -> list[Person]:
    statement = (
        select(
            Participant.pseudonym,
            func.count(SessionRow.id),
            func.max(SessionRow.mode),
            Participant.created_at,
        )
        .join(SessionRow, SessionRow.participant_id == Participant.id)
        .where(Participant.study_id == study_id)
        .group_by(Participant.id, Participant.pseudonym, Participant.created_at)
        .order_by(Participant.id.desc())
        .limit(limit)
    )
    if pseudonym is not None:
        statement = statement.where(Participant.pseudonym == pseudonym)
    with app.database.read() as db:
        return [Person(*row) for row in db.execute(statement)]
