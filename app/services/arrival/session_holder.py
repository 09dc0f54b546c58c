"""The session that a browser's cookie leads to: whose it is, and what its holder may do with it.

An identity in the request outranks the cookie: on a shared computer the next person brings an id or
a link of their own, and must not find the session of the last one.
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

#: For how long after its end a browser still finds a session by its cookie.
KEPT_AFTER_END = timedelta(days=1)

_LIVE = "live"


class Holder(StrEnum):
    """Who the person is that a request comes from, as against the session of its cookie."""

    #: There is no session, or one that ended long ago.
    NOBODY = "nobody"
    #: The session's own person, as far as anybody can tell.
    SAME = "same"
    #: The request names a person, and the session began without a name: only they can say.
    UNCERTAIN = "uncertain"
    #: The request names another person than the session's.
    OTHER = "other"


def holder(app: AppContext, slug: str, token: str | None, ids: Mapping[str, str]) -> Holder:
    """Who comes with this token in the cookie and these ids in the link."""
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
    """Until when a browser finds the ended session of this token; None while it goes on."""
    with app.database.read() as db:
        row = _find(app, db, slug, token)
        return None if row is None else _kept_until(db, row, token)


def add_ids(app: AppContext, slug: str, token: str, ids: Mapping[str, str]) -> None:
    """Keep the ids of a session's person, who has said that they are the one.

    Raises SignInRequiredError where the token leads to no session, and KnownPersonError where the
    ids are of somebody who has a session of their own.
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
    """A day from the end, or from when the person came back to it in this browser."""
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
        # Somebody who looked at the study in this browser before.
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
