"""Deletes participants and sessions for good; only a tombstone remains, for counting."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Literal

from sqlalchemy import delete, select
from sqlalchemy.orm import Session, selectinload

from app.services import deletion_log
from app.services.context import AppContext
from app.services.rollouts import requests
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import Participant, SessionRow

#: At the person's request, or by the study's retention rule.
Reason = Literal["wish", "retention"]


def delete_person(
    app: AppContext,
    db: Session,
    participant_id: int,
    reason: Reason = "wish",
    at: datetime | None = None,
) -> frozenset[int]:
    """Delete a participant with all their sessions.

    Returns the seeds of their trials, for `purge_traces`. at: when the deletion was requested, if
    that is not now.
    """
    rows = db.scalars(
        select(SessionRow)
        .where(SessionRow.participant_id == participant_id)
        .options(selectinload(SessionRow.trials))
        .order_by(SessionRow.id)
        # Locked, so that work ahead of a session asks machines before this transaction, or not.
        .with_for_update(of=SessionRow)
    ).all()
    seeds = _write_tombstones(app, db, rows, reason, at)
    # All other rows are deleted by cascading foreign keys.
    db.execute(
        delete(Participant).where(Participant.id == participant_id),
        execution_options={"synchronize_session": False},
    )
    return seeds


def delete_session(
    app: AppContext,
    db: Session,
    session: SessionRow,
    reason: Reason,
    at: datetime | None = None,
) -> frozenset[int]:
    """Delete one session, and its participant if it was their only one; as `delete_person`."""
    # Locked, so that a session that starts meanwhile waits, and then has a participant of its own.
    db.get_one(Participant, session.participant_id, with_for_update=True)
    others = db.scalar(
        select(SessionRow.id)
        .where(SessionRow.participant_id == session.participant_id, SessionRow.id != session.id)
        .limit(1)
    )
    if others is None:
        return delete_person(app, db, session.participant_id, reason, at)
    seeds = _write_tombstones(app, db, [session], reason, at)
    db.execute(
        delete(SessionRow).where(SessionRow.id == session.id),
        execution_options={"synchronize_session": False},
    )
    return seeds


def purge_traces(app: AppContext, seeds: frozenset[int]) -> None:
    """Evict deleted trials from the caches, and scrub deleted rows from the database file."""
    app.proposer.purge(seeds)
    app.recordings.clear_session_cache()
    app.database.scrub()


def _write_tombstones(
    app: AppContext,
    db: Session,
    rows: Sequence[SessionRow],
    reason: Reason,
    at: datetime | None,
) -> frozenset[int]:
    """Append to the deletion log and insert a tombstone per session; the seeds of all trials.

    Rollouts that only these sessions asked for are taken back.
    """
    now = app.now() if at is None else at
    app.deletion_log.append(now, reason, [deletion_log.session_key(row.token_hash) for row in rows])
    # Only the day is stored: an exact time could be matched with other records of that moment.
    day = now.replace(hour=0, minute=0, second=0, microsecond=0)
    db.add_all(
        Tombstone(
            study_id=row.study_id, mode=row.mode, stage=row.stage, deleted_at=day, reason=reason
        )
        for row in rows
    )
    for trial in (trial for row in rows for trial in row.trials):
        # No machine runs for somebody who is gone.
        requests.take_back(db, trial.id, keep=(), now=now, is_over=True)
    db.flush()
    return frozenset(trial.seed for row in rows for trial in row.trials)
