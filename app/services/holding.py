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

from app.storage.arrivals import Reentry
from app.storage.tables import SessionRow
from app.study import recruitment as rules
from app.study.plan import Plan

from . import recruitment, returning, sessions, studies
from . import state as session_state
from .errors import KnownPersonError, SignInRequiredError
from .studio import Studio
from .tokens import receipt_code, receipt_hash, secret_hash

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


def holder(studio: Studio, slug: str, token: str | None, ids: Mapping[str, str]) -> Holder:
    """Who comes with this token in the cookie and these ids in the link."""
    if token is None:
        return Holder.NOBODY
    with studio.database.read() as session:
        row = _find(studio, session, slug, token)
        if row is None:
            return Holder.NOBODY
        until = _kept_until(session, row, token)
        if until is not None and studio.now() >= until:
            return Holder.NOBODY
        return _compared(session, row, ids)


def kept_until(studio: Studio, slug: str, token: str) -> datetime | None:
    """Until when a browser finds the ended session of this token; None while it goes on."""
    with studio.database.read() as session:
        row = _find(studio, session, slug, token)
        return None if row is None else _kept_until(session, row, token)


def add_ids(studio: Studio, slug: str, token: str, ids: Mapping[str, str]) -> None:
    """Keep the ids of a session's person, who has said that they are the one.

    Raises SignInRequiredError where the token leads to no session, and KnownPersonError where the
    ids are of somebody who has a session of their own.
    """
    with studio.database.write() as session:
        row = _find(studio, session, slug, token)
        if row is None:
            raise SignInRequiredError("expected the token of a session, got one of no session")
        if _compared(session, row, ids) is not Holder.UNCERTAIN:
            return
        study = studies.read(session, slug)
        if returning.earlier_session(session, study, row.mode, ids) is not None:
            raise KnownPersonError(
                "expected ids of nobody yet, and somebody of this id has begun this study",
                may_resume=False,
            )
        returning.write_ids(studio, session, row.participant_id, ids)


def receipt(studio: Studio, token: str) -> str | None:
    """The receipt code that goes with this token.

    None for a browser that was let in by a platform's ids, and where there is no session.
    """
    with studio.database.read() as session:
        return receipt_code(token) if has_all_rights(session, token) else None


def has_all_rights(session: Session, token: str) -> bool:
    """Whether the holder of this token may see the receipt and delete what the person gave."""
    hashed = secret_hash(token)
    if session.scalar(select(SessionRow.id).where(SessionRow.token_hash == hashed)) is not None:
        return True
    of_receipt = select(Reentry.id).where(
        Reentry.token_hash == hashed, Reentry.receipt_hash == receipt_hash(receipt_code(token))
    )
    return session.scalar(of_receipt) is not None


def _find(studio: Studio, session: Session, slug: str, token: str) -> SessionRow | None:
    try:
        row = sessions.find(studio, session, token, even_expired=True)
    except SignInRequiredError:
        return None
    return row if row.study.slug == slug else None


def _kept_until(session: Session, row: SessionRow, token: str) -> datetime | None:
    """A day from the end, or from when the person came back to it in this browser."""
    if row.ended_at is None:
        return None
    came_back = session.scalar(
        select(Reentry.created_at).where(Reentry.token_hash == secret_hash(token))
    )
    return max(row.ended_at, came_back or row.ended_at) + KEPT_AFTER_END


def _compared(session: Session, row: SessionRow, ids: Mapping[str, str]) -> Holder:
    plan = studies.stored_plan(row.plan)
    person, submission = _names(plan, ids)
    if person is None and submission is None:
        return Holder.SAME
    if row.mode != _LIVE:
        # Somebody who looked at the study in this browser before.
        return Holder.OTHER
    kept_person, kept_submission = _names(plan, recruitment.ids_of(session, row.participant_id))
    has_ended = row.stage in session_state.ENDED
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
