"""Finds a session by the token of its browser or program, and advances it."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session, joinedload

from app.services.context import AppContext
from app.services.runtime.errors import SessionExpiredError, SessionTooOldError, SignInRequiredError
from app.services.runtime.ids import secret_hash
from app.services.studies import repository
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import PlanVersion, SessionRow, Study
from app.study import stages
from app.study.plan import Plan

from . import consents
from . import state_view as session_state


def find(
    app: AppContext,
    db: Session,
    token: str,
    *,
    to_write: bool = False,
    even_expired: bool = False,
) -> SessionRow:
    """The session of this token, or of a re-entry token that leads to it.

    to_write: lock the row until the transaction ends. even_expired: return an expired session, too.
    Raises SignInRequiredError if no session has the token, SessionExpiredError, or
    SessionTooOldError.
    """
    hashed = {"hashed": secret_hash(token)}
    found = db.execute(_TO_WRITE if to_write else _TO_READ, hashed).first()
    if found is None:
        came_back = _CAME_BACK_TO_WRITE if to_write else _CAME_BACK_TO_READ
        found = db.execute(came_back, hashed).first()
    if found is None:
        raise SignInRequiredError("expected the token of a session, got one that nobody was given")
    session: SessionRow = found[0]
    session.newest_plan_id = found[1]
    # The session may be described after this transaction, when deferred columns cannot be loaded.
    plan, _ = repository.stored_plan(session.plan), repository.stored_texts(session.plan)
    open_still = session.stage not in session_state.ENDED
    if open_still and not even_expired and app.now() >= session.expires_at:
        raise SessionExpiredError(
            f"the session expired at {session.expires_at.isoformat(timespec='seconds')}"
        )
    if not even_expired:
        refuse_if_too_old(plan, session, app.now())
    return session


def refuse_if_too_old(plan: Plan, session: SessionRow, now: datetime) -> None:
    """Raise SessionTooOldError if the session was inactive for too long to be resumed."""
    if is_too_old(plan, session, now):
        raise SessionTooOldError(
            f"expected to be back within {plan.resume.max_age_hours:g} hours,"
            f" the session was left at {session.last_seen_at.isoformat(timespec='seconds')}",
            plan.resume.policy,
        )


def is_too_old(plan: Plan, session: SessionRow, now: datetime) -> bool:
    """Whether an unfinished session was inactive for longer than `resume.max_age_hours`."""
    hours = plan.resume.max_age_hours
    return (
        hours is not None
        and session.stage not in session_state.ENDED
        and now - session.last_seen_at >= timedelta(hours=hours)
    )


def require_asked(session: SessionRow, query_index: int) -> None:
    """Raise OutOfOrder unless the session's open query has this index."""
    progress = session_state.read_progress(session)
    stages.require_asked(repository.plan_of(session), progress, query_index)


def advance(app: AppContext, session: SessionRow, event: stages.Event) -> None:
    """Apply an event of the protocol to the session.

    Raises a ProtocolError if it is not allowed now.
    """
    if isinstance(event, stages.Continued | stages.Answered | stages.ScreenedOut):
        # Responses are not checked: one given before the consent text changed must not be lost.
        consents.require_none_due(session)
    plan = repository.plan_of(session)
    session_state.store_progress(
        session, stages.advance(plan, session_state.read_progress(session), event)
    )
    session.last_seen_at = app.now()
    if session.stage in session_state.ENDED:
        session.ended_at = app.now()


# Built once: for such small queries, building the statement takes as long as executing it.
# The long columns of a plan version are deferred; its parsed form is cached by `plan_hash`.
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
