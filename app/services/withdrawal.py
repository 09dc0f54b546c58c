"""Leaving a study: to stop, and to have deleted what one gave.

Deletion is real. The person's sessions go with everything that hangs on them, and so do their
pseudonym and what a platform calls them; what was worked out from their answers is forgotten. For
the count there remains that a session was deleted, on which day, and how far it had come.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session, selectinload

from app.storage.arrivals import Reentry, Tombstone
from app.storage.tables import Identity, Participant, SessionRow, Study
from app.study import protocol
from app.study.protocol import Stage

from . import sessions
from . import state as session_state
from .errors import NotFoundError
from .state import State
from .studio import Studio
from .tokens import receipt_hash


def withdraw(studio: Studio, token: str) -> State:
    """Stop, and leave what was answered. Before consent: decline, and leave no platform's id."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        sessions.advance(studio, row, protocol.Withdrew())
        if row.stage == Stage.DECLINED:
            session.execute(delete(Identity).where(Identity.participant_id == row.participant_id))
        return session_state.describe(studio, session, row)


def withdraw_and_delete(studio: Studio, token: str) -> State:
    """Stop, at any stage, and delete what the person gave. The token is worth nothing then."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True, even_expired=True)
        came_to = row.stage
        if came_to not in session_state.ENDED:
            sessions.advance(studio, row, protocol.Withdrew())
        state = {**session_state.describe(studio, session, row), "deleted": True}
        if state["stage"] != Stage.DECLINED:
            state["stage"] = Stage.WITHDRAWN.value
        # As it was before this very request: that is how far the person came.
        row.stage = came_to
        seeds = _delete(session, row.participant_id, studio.now())
    _forget(studio, seeds)
    return state


def delete_by_receipt(studio: Studio, slug: str, receipt: str) -> None:
    """Delete what the holder of this receipt gave. Raises NotFoundError if nobody has it.

    Whoever tries receipts at random would need 2^76 of them: no limit on tries is needed, and so
    nothing has to be kept of those who try.
    """
    with studio.database.write() as session:
        hashed = receipt_hash(receipt)
        came_back = select(Reentry.session_id).where(Reentry.receipt_hash == hashed)
        participant_id = session.scalar(
            select(SessionRow.participant_id)
            .join(Study, SessionRow.study_id == Study.id)
            .where(
                Study.slug == slug,
                or_(SessionRow.receipt_hash == hashed, SessionRow.id.in_(came_back)),
            )
        )
        if participant_id is None:
            raise NotFoundError("expected a receipt code of this study, and nothing is kept for it")
        seeds = _delete(session, participant_id, studio.now())
    _forget(studio, seeds)


def _delete(session: Session, participant_id: int, now: datetime) -> frozenset[int]:
    """Delete a person with all their sessions; the seeds of their trials."""
    rows = session.scalars(
        select(SessionRow)
        .where(SessionRow.participant_id == participant_id)
        .options(selectinload(SessionRow.trials))
    ).all()
    # The day alone: a moment could be matched with what somebody else saw at that moment.
    day = now.replace(hour=0, minute=0, second=0, microsecond=0)
    session.add_all(
        Tombstone(study_id=row.study_id, mode=row.mode, stage=row.stage, deleted_at=day)
        for row in rows
    )
    seeds = frozenset(trial.seed for row in rows for trial in row.trials)
    session.flush()
    # Everything else hangs on the participant by foreign keys that cascade.
    session.execute(
        delete(Participant).where(Participant.id == participant_id),
        execution_options={"synchronize_session": False},
    )
    return seeds


def _forget(studio: Studio, seeds: frozenset[int]) -> None:
    """Leave no trace in memory, nor in what the database still has on the disk."""
    studio.proposer.forget(seeds)
    studio.database.scrub()
