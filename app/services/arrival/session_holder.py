"""Decides whether a request comes from the person whose session its cookie belongs to.

An identity in the request takes precedence over the cookie: on a shared computer the next person
brings an id or a link of their own, and must not enter the previous person's session.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from enum import StrEnum

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import KnownPersonError, SignInRequiredError
from app.services.runtime.ids import secret_hash
from app.services.sessions import completion, lookup
from app.services.sessions import state_view as session_state
from app.services.studies import repository
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import SessionRow
from app.study import recruitment as rules
from app.study.plan import Plan

from . import re_entry

#: How long after a session's end its cookie still leads to it.
KEPT_AFTER_END = timedelta(days=1)

_LIVE = "live"


class Holder(StrEnum):
    """The person of a request in relation to the session of its cookie."""

    #: There is no session, or it ended more than `KEPT_AFTER_END` ago.
    NOBODY = "nobody"
    #: As far as can be told, the person of the session.
    SAME = "same"
    #: The request has ids and the session has none, so the person has to be asked.
    UNCERTAIN = "uncertain"
    #: The request has the ids of another person.
    OTHER = "other"


def holder(app: AppContext, slug: str, token: str | None, ids: Mapping[str, str]) -> Holder:
    """Compare the person of a request to the session of its cookie.

    token: from the cookie. ids: the platform ids of the link.
    """
    if token is None:
        return Holder.NOBODY
    with app.database.read() as db:
        row = _find(app, db, slug, token)
        if row is None:
            return Holder.NOBODY
        until = _kept_until(db, row, token)
        if until is not None and app.now() >= until:
            return Holder.NOBODY
        return _compared(db, row, ids)


def kept_until(app: AppContext, slug: str, token: str) -> datetime | None:
    """Until when the cookie of an ended session leads to it; None while the session goes on."""
    with app.database.read() as db:
        row = _find(app, db, slug, token)
        return None if row is None else _kept_until(db, row, token)


def add_ids(app: AppContext, slug: str, token: str, ids: Mapping[str, str]) -> None:
    """Store the ids of a session's person, after they have confirmed who they are.

    Raises SignInRequiredError if no session has the token, and KnownPersonError if another session
    has the ids.
    """
    with app.database.write() as db:
        row = _find(app, db, slug, token)
        if row is None:
            raise SignInRequiredError("expected the token of a session, got one of no session")
        if _compared(db, row, ids) is not Holder.UNCERTAIN:
            return
        study = repository.read(db, slug)
        if re_entry.earlier_session(db, study, row.mode, ids) is not None:
            raise KnownPersonError(
                "expected ids of nobody yet, and somebody of this id has begun this study",
                may_resume=False,
            )
        re_entry.write_ids(app, db, row.participant_id, ids)


def _find(app: AppContext, db: Session, slug: str, token: str) -> SessionRow | None:
    try:
        session = lookup.find(app, db, token, even_expired=True)
    except SignInRequiredError:
        return None
    return session if session.study.slug == slug else None


def _kept_until(db: Session, session: SessionRow, token: str) -> datetime | None:
    """A day after the session's end, or after the person re-entered it with this token."""
    if session.ended_at is None:
        return None
    came_back = db.scalar(
        select(Reentry.created_at).where(Reentry.token_hash == secret_hash(token))
    )
    return max(session.ended_at, came_back or session.ended_at) + KEPT_AFTER_END


def _compared(db: Session, session: SessionRow, ids: Mapping[str, str]) -> Holder:
    plan = repository.stored_plan(session.plan)
    person, submission = _names(plan, ids)
    if person is None and submission is None:
        return Holder.SAME
    if session.mode != _LIVE:
        # A preview or pilot that was looked at in this browser before.
        return Holder.OTHER
    kept_person, kept_submission = _names(plan, completion.ids_of(db, session.participant_id))
    has_ended = session.stage in session_state.ENDED
    if person is not None and kept_person is not None:
        if person != kept_person:
            return Holder.OTHER
        comes_again = (
            has_ended
            and plan.recruitment.returning == "again"
            and None not in (submission, kept_submission)
            and submission != kept_submission
        )
        return Holder.OTHER if comes_again else Holder.SAME
    if submission is not None and kept_submission is not None:
        return Holder.SAME if submission == kept_submission else Holder.OTHER
    return Holder.OTHER if has_ended else Holder.UNCERTAIN


def _names(plan: Plan, ids: Mapping[str, str]) -> tuple[object, object]:
    return rules.person(plan.recruitment, ids), rules.submission(plan.recruitment, ids)
