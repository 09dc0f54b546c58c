"""Lookup of a study's participants, for people who ask for their data or its deletion."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Select, func, select

from app.services.context import AppContext
from app.services.runtime.errors import NotFoundError
from app.storage.models.studies import Identity, Participant, SessionRow

from .receipts import session_of_receipt

#: So much of what was typed is repeated in a message.
LONGEST_SHOWN = 60


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


def find_by_any(app: AppContext, slug: str, study_id: int, called: str) -> list[Person]:
    """The participants that a person may be: by pseudonym, receipt code or platform id.

    One id of a platform can belong to several participants, where a study takes people again.
    Raises NotFoundError if there is none.
    """
    typed = called.strip()
    with app.database.read() as db:
        by_id = select(Identity.participant_id).where(Identity.value == typed)
        wanted = (Participant.pseudonym == typed.upper()) | Participant.id.in_(by_id)
        of_receipt = session_of_receipt(db, slug, typed)
        if of_receipt is not None:
            wanted |= Participant.id == of_receipt.participant_id
        found = [Person(*row) for row in db.execute(_persons(study_id).where(wanted))]
    if not found:
        raise NotFoundError(
            "expected the pseudonym, the receipt code or the platform's id of a participant,"
            f" and {typed[:LONGEST_SHOWN]!r} is none in this study"
        )
    return found


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
    statement = _persons(study_id).limit(limit)
    if pseudonym is not None:
        statement = statement.where(Participant.pseudonym == pseudonym)
    with app.database.read() as db:
        return [Person(*row) for row in db.execute(statement)]


def _persons(study_id: int) -> Select[str, int, str, datetime]:
    """The participants of a study as rows of `Person`, the newest first."""
    return (
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
    )
