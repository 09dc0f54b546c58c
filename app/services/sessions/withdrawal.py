"""Leaving a study: to stop, and to have deleted what one gave.

Deletion is real. The person's sessions go with everything that hangs on them, and so do their
pseudonym and what a platform calls them; what was worked out from their answers is forgotten. For
the count there remains that a session was deleted, on which day, and how far it had come.
"""

from __future__ import annotations

from sqlalchemy import delete, select

from app.services import deletion_log
from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, NotFoundError
from app.services.sessions import receipts
from app.storage.models.studies import Identity, Participant, Study
from app.study import protocol
from app.study.protocol import Stage

from . import deletion, lookup
from . import state_view as session_state
from .state_view import State


def withdraw(app: AppContext, token: str) -> State:
    """Stop, and leave what was answered. Before consent: decline, and leave no platform's id."""
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        lookup.advance(app, session, protocol.Withdrew())
        if session.stage == Stage.DECLINED:
            key = deletion_log.session_key(session.token_hash)
            app.deletion_log.note(app.now(), deletion_log.IDENTITIES, [key])
            db.execute(delete(Identity).where(Identity.participant_id == session.participant_id))
        return session_state.describe(app, db, session)


def withdraw_and_delete(app: AppContext, token: str) -> State:
    """Stop, at any stage, and delete what the person gave. The token is worth nothing then.

    Raises ForbiddenError for a browser that was let in by a platform's ids.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True, even_expired=True)
        if not receipts.has_all_rights(db, token):
            raise ForbiddenError(
                "expected the browser in which the session began, or its receipt code: a platform's"
                " ids delete nothing"
            )
        came_to = session.stage
        if came_to not in session_state.ENDED:
            lookup.advance(app, session, protocol.Withdrew())
        state = {**session_state.describe(app, db, session), "deleted": True}
        if state["stage"] != Stage.DECLINED:
            state["stage"] = Stage.WITHDRAWN.value
        # As it was before this very request: that is how far the person came.
        session.stage = came_to
        seeds = deletion.delete_person(app, db, session.participant_id)
    deletion.purge_traces(app, seeds)
    return state


def is_receipt(app: AppContext, slug: str, receipt: str) -> bool:
    """Whether something is kept under this receipt code."""
    with app.database.read() as db:
        return receipts.session_of_receipt(db, slug, receipt) is not None


def delete_by_receipt(app: AppContext, slug: str, receipt: str, actor: str | None = None) -> None:
    """Delete what the holder of this receipt gave. Raises NotFoundError if nobody has it.

    Whoever tries receipts at random would need 2^76 of them: no limit on tries is needed, and so
    nothing has to be kept of those who try.

    actor: the experimenter whom the person asked to do it; None: the person did.
    """
    with app.database.write() as db:
        row = receipts.session_of_receipt(db, slug, receipt)
        if row is None:
            raise NotFoundError("expected a receipt code of this study, and nothing is kept for it")
        seeds = deletion.delete_person(app, db, row.participant_id)
        if actor is not None:
            audit_log.note(db, app.now(), actor, "participant deleted", slug, by="receipt code")
    deletion.purge_traces(app, seeds)


def delete_participant(app: AppContext, slug: str, pseudonym: str, actor: str) -> None:
    """Delete a person at their wish, by their pseudonym. Raises NotFoundError.

    The audit trail tells that somebody was deleted, and not who.
    """
    with app.database.write() as db:
        participant_id = db.scalar(
            select(Participant.id)
            .join(Study, Participant.study_id == Study.id)
            .where(Study.slug == slug, Participant.pseudonym == pseudonym.strip().upper())
        )
        if participant_id is None:
            raise NotFoundError(f"expected a participant of this study, and {pseudonym!r} is none")
        seeds = deletion.delete_person(app, db, participant_id)
        audit_log.note(db, app.now(), actor, "participant deleted", slug, by="pseudonym")
    deletion.purge_traces(app, seeds)
