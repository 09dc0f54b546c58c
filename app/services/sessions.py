"""A session's row: found by the token that its browser or program holds, and moved on."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session, joinedload

from app.storage.arrivals import Reentry
from app.storage.tables import PlanVersion, SessionRow, Study
from app.study import protocol
from app.study.plan import Plan

from . import consents, studies
from . import state as session_state
from .errors import SessionExpiredError, SessionTooOldError, SignInRequiredError
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
    hashed = {"hashed": secret_hash(token)}
    found = session.execute(_TO_WRITE if to_write else _TO_READ, hashed).first()
    if found is None:
        came_back = _CAME_BACK_TO_WRITE if to_write else _CAME_BACK_TO_READ
        found = session.execute(came_back, hashed).first()
    if found is None:
        raise SignInRequiredError("expected the token of a session, got one that nobody was given")
    row: SessionRow = found[0]
    row.newest_plan_id = found[1]
    open_still = row.stage not in session_state.ENDED
    if open_still and not even_expired and studio.now() >= row.expires_at:
        raise SessionExpiredError(
            f"the session expired at {row.expires_at.isoformat(timespec='seconds')}"
        )
    if not even_expired:
        refuse_if_too_old(studies.stored_plan(row.plan), row, studio.now())
    return row


def refuse_if_too_old(plan: Plan, row: SessionRow, now: datetime) -> None:
    """Raises SessionTooOldError if the session was left for too long to be resumed."""
    if is_too_old(plan, row, now):
        raise SessionTooOldError(
            f"expected to be back within {plan.resume.max_age_hours:g} hours,"
            f" the session was left at {row.last_seen_at.isoformat(timespec='seconds')}",
            plan.resume.policy,
        )


def is_too_old(plan: Plan, row: SessionRow, now: datetime) -> bool:
    """Whether an unfinished session was left for longer than its study lets one resume it."""
    hours = plan.resume.max_age_hours
    return (
        hours is not None
        and row.stage not in session_state.ENDED
        and now - row.last_seen_at >= timedelta(hours=hours)
    )


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


# Made once: what is asked with every request takes as long to be put together as to be answered.
# Plans and texts, which are long, are known by their hash.
_WITH_ITS_STUDY = select(SessionRow, consents.NEWEST_OF_SESSION).options(
    joinedload(SessionRow.plan).load_only(
        PlanVersion.study_id, PlanVersion.version, PlanVersion.plan_hash
    ),
    joinedload(SessionRow.study).load_only(Study.slug),
)
_TO_READ = _WITH_ITS_STUDY.where(SessionRow.token_hash == bindparam("hashed"))
_TO_WRITE = _TO_READ.with_for_update(of=SessionRow)
_CAME_BACK_TO_READ = _WITH_ITS_STUDY.where(
    SessionRow.id.in_(select(Reentry.session_id).where(Reentry.token_hash == bindparam("hashed")))
)
_CAME_BACK_TO_WRITE = _CAME_BACK_TO_READ.with_for_update(of=SessionRow)
