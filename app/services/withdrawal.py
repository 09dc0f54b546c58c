"""Leaving a study: to stop, and to have deleted what one gave.

Deletion is real. The person's sessions go with everything that hangs on them, and so do their
pseudonym and what a platform calls them; what was worked out from their answers is forgotten. For
the count there remains that a session was deleted, on which day, and how far it had come.
"""

from __future__ import annotations

from sqlalchemy import delete, select

from app.storage.tables import Identity, Participant, Study
from app.study import protocol
from app.study.protocol import Stage

from . import audit, deletion, holding, ledger, returning, sessions
from . import state as session_state
from .errors import ForbiddenError, NotFoundError
from .state import State
from .studio import Studio


def withdraw(studio: Studio, token: str) -> State:
    """Stop, and leave what was answered. Before consent: decline, and leave no platform's id."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        sessions.advance(studio, row, protocol.Withdrew())
        if row.stage == Stage.DECLINED:
            key = ledger.session_key(row.token_hash)
            studio.ledger.note(studio.now(), ledger.IDENTITIES, [key])
            session.execute(delete(Identity).where(Identity.participant_id == row.participant_id))
        return session_state.describe(studio, session, row)


def withdraw_and_delete(studio: Studio, token: str) -> State:
    """Stop, at any stage, and delete what the person gave. The token is worth nothing then.

    Raises ForbiddenError for a browser that was let in by a platform's ids.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True, even_expired=True)
        if not holding.has_all_rights(session, token):
            raise ForbiddenError(
                "expected the browser in which the session began, or its receipt code: a platform's"
                " ids delete nothing"
            )
        came_to = row.stage
        if came_to not in session_state.ENDED:
            sessions.advance(studio, row, protocol.Withdrew())
        state = {**session_state.describe(studio, session, row), "deleted": True}
        if state["stage"] != Stage.DECLINED:
            state["stage"] = Stage.WITHDRAWN.value
        # As it was before this very request: that is how far the person came.
        row.stage = came_to
        seeds = deletion.delete_person(studio, session, row.participant_id)
    deletion.forget(studio, seeds)
    return state


def is_receipt(studio: Studio, slug: str, receipt: str) -> bool:
    """Whether something is kept under this receipt code."""
    with studio.database.read() as session:
        return returning.session_of_receipt(session, slug, receipt) is not None


def delete_by_receipt(studio: Studio, slug: str, receipt: str, actor: str | None = None) -> None:
    """Delete what the holder of this receipt gave. Raises NotFoundError if nobody has it.

    Whoever tries receipts at random would need 2^76 of them: no limit on tries is needed, and so
    nothing has to be kept of those who try.

    actor: the experimenter whom the person asked to do it; None: the person did.
    """
    with studio.database.write() as session:
        row = returning.session_of_receipt(session, slug, receipt)
        if row is None:
            raise NotFoundError("expected a receipt code of this study, and nothing is kept for it")
        seeds = deletion.delete_person(studio, session, row.participant_id)
        if actor is not None:
            audit.note(session, studio.now(), actor, "participant deleted", slug, by="receipt code")
    deletion.forget(studio, seeds)


def delete_participant(studio: Studio, slug: str, pseudonym: str, actor: str) -> None:
    """Delete a person at their wish, by their pseudonym. Raises NotFoundError.

    The audit trail tells that somebody was deleted, and not who.
    """
    with studio.database.write() as session:
        participant_id = session.scalar(
            select(Participant.id)
            .join(Study, Participant.study_id == Study.id)
            .where(Study.slug == slug, Participant.pseudonym == pseudonym.strip().upper())
        )
        if participant_id is None:
            raise NotFoundError(f"expected a participant of this study, and {pseudonym!r} is none")
        seeds = deletion.delete_person(studio, session, participant_id)
        audit.note(session, studio.now(), actor, "participant deleted", slug, by="pseudonym")
    deletion.forget(studio, seeds)
