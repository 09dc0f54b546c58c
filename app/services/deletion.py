"""Deleting what people gave: for good, with a tombstone for the count and nothing besides."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Literal

from sqlalchemy import delete, select
from sqlalchemy.orm import Session, selectinload

from app.storage.arrivals import Tombstone
from app.storage.tables import Participant, SessionRow

from . import ledger
from .studio import Studio

#: At the person's wish, or by the study's retention rule.
Reason = Literal["wish", "retention"]


def delete_person(
    studio: Studio,
    session: Session,
    participant_id: int,
    reason: Reason = "wish",
    at: datetime | None = None,
) -> frozenset[int]:
    """Delete a person with all their sessions; the seeds of their trials, for `forget`.

    at: when it was asked for, if that is not now.
    """
    rows = session.scalars(
        select(SessionRow)
        .where(SessionRow.participant_id == participant_id)
        .options(selectinload(SessionRow.trials))
    ).all()
    seeds = _bury(studio, session, rows, reason, at)
    # Everything else hangs on the participant by foreign keys that cascade.
    session.execute(
        delete(Participant).where(Participant.id == participant_id),
        execution_options={"synchronize_session": False},
    )
    return seeds


def delete_session(
    studio: Studio,
    session: Session,
    row: SessionRow,
    reason: Reason,
    at: datetime | None = None,
) -> frozenset[int]:
    """Delete one session; its person too if it was their only one. The seeds of its trials."""
    # Locked: whoever comes again just now waits, and is then a person of one session.
    session.get_one(Participant, row.participant_id, with_for_update=True)
    others = session.scalar(
        select(SessionRow.id)
        .where(SessionRow.participant_id == row.participant_id, SessionRow.id != row.id)
        .limit(1)
    )
    if others is None:
        return delete_person(studio, session, row.participant_id, reason, at)
    seeds = _bury(studio, session, [row], reason, at)
    session.execute(
        delete(SessionRow).where(SessionRow.id == row.id),
        execution_options={"synchronize_session": False},
    )
    return seeds


def forget(studio: Studio, seeds: frozenset[int]) -> None:
    """Leave no trace in memory, nor in what the database still has on the disk."""
    studio.proposer.purge(seeds)
    studio.recordings.forget_shown()
    studio.database.scrub()


def _bury(
    studio: Studio,
    session: Session,
    rows: Sequence[SessionRow],
    reason: Reason,
    at: datetime | None,
) -> frozenset[int]:
    now = studio.now() if at is None else at
    studio.ledger.note(now, reason, [ledger.session_key(row.token_hash) for row in rows])
    # The day alone: a moment could be matched with what somebody else saw at that moment.
    day = now.replace(hour=0, minute=0, second=0, microsecond=0)
    session.add_all(
        Tombstone(
            study_id=row.study_id, mode=row.mode, stage=row.stage, deleted_at=day, reason=reason
        )
        for row in rows
    )
    session.flush()
    return frozenset(trial.seed for row in rows for trial in row.trials)
