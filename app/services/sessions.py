"""A session's row: found by the token that its browser or program holds, and moved on."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session, joinedload, selectinload

from app.storage.arrivals import Reentry
from app.storage.tables import SessionRow
from app.study import protocol

from . import consents, places, studies
from . import state as session_state
from .errors import SessionExpiredError, SignInRequiredError
from .studio import Studio
from .tokens import secret_hash


def find(
    studio: Studio,
    session: Session,
    token: str,
    *,
    to_write: bool = False,
    even_expired: bool = False,
) -> SessionRow:
    """The session of this token. Raises SignInRequiredError, or SessionExpiredError."""
    hashed = secret_hash(token)
    statement = select(SessionRow).options(
        selectinload(SessionRow.trials),
        joinedload(SessionRow.plan),
        joinedload(SessionRow.study),
    )
    if to_write:
        statement = statement.with_for_update(of=SessionRow)
    row = session.scalar(statement.where(SessionRow.token_hash == hashed))
    if row is None:
        came_back = select(Reentry.session_id).where(Reentry.token_hash == hashed)
        row = session.scalar(statement.where(SessionRow.id.in_(came_back)))
    if row is None:
        raise SignInRequiredError("expected the token of a session, got one that nobody was given")
    open_still = row.stage not in session_state.ENDED
    if open_still and not even_expired and studio.now() >= row.expires_at:
        raise SessionExpiredError(
            f"the session expired at {row.expires_at.isoformat(timespec='seconds')}"
        )
    if not even_expired:
        places.refuse_if_too_old(studies.stored_plan(row.plan), row, studio.now())
    return row


def require_asked(row: SessionRow, query_index: int) -> None:
    """Raises OutOfOrder unless the session's query of this index waits for its response."""
    progress = session_state.read_progress(row)
    protocol.require_asked(studies.plan_of(row), progress, query_index)


def advance(studio: Studio, row: SessionRow, event: protocol.Event) -> None:
    """Move the session on by what happened. Raises a ProtocolError if it cannot happen now."""
    if isinstance(event, protocol.Continued | protocol.Answered | protocol.ScreenedOut):
        # A response given before the text changed is taken all the same: nothing is lost.
        consents.require_none_due(row)
    plan = studies.plan_of(row)
    session_state.place(row, protocol.advance(plan, session_state.read_progress(row), event))
    row.last_seen_at = studio.now()
    if row.stage in session_state.ENDED:
        row.ended_at = studio.now()
