"""Withdrawal from a study, with or without the deletion of the person's data.

Deletion is real: the sessions go with all dependent rows, the pseudonym and the platform ids, and
computed results leave the caches. A tombstone without personal data keeps the day and the last
stage, for counting.
"""

from __future__ import annotations

from sqlalchemy import delete, select

from app.services import deletion_log
from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, NotFoundError
from app.storage.models.studies import Identity, Participant, Study
from app.study import stages
from app.study.stages import Stage

from . import box_ahead, deletion, lookup, receipts
from . import state_view as session_state
from .state_view import State


def withdraw(app: AppContext, token: str) -> State:
    """End the session and keep the responses.

    Before the consent: decline, and delete platform ids.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        lookup.advance(app, session, stages.Withdrew())
        box_ahead.leave(db, session.id, app.now())
        if session.stage == Stage.DECLINED:
            key = deletion_log.session_key(session.token_hash)
            app.deletion_log.append(app.now(), deletion_log.IDENTITIES, [key])
            db.execute(delete(Identity).where(Identity.participant_id == session.participant_id))
        return session_state.describe(app, db, session)


def withdraw_and_delete(app: AppContext, token: str) -> State:
    """End the session at any stage and delete the person's data; the token becomes invalid.

    Raises ForbiddenError for a browser that was let in by platform ids.
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
            lookup.advance(app, session, stages.Withdrew())
        state = {**session_state.describe(app, db, session), "deleted": True}
        if state["stage"] != Stage.DECLINED:
            state["stage"] = Stage.WITHDRAWN.value
        box_ahead.leave(db, session.id, app.now())
        # Restored for the tombstone, which counts how far the person came.
        session.stage = came_to
        seeds = deletion.delete_person(app, db, session.participant_id)
    deletion.purge_traces(app, seeds)
    return state


def is_receipt(app: AppContext, slug: str, receipt: str) -> bool:
    """Whether a session of the study has this receipt code."""
    with app.database.read() as db:
        return receipts.session_of_receipt(db, slug, receipt) is not None


def delete_by_receipt(app: AppContext, slug: str, receipt: str, actor: str | None = None) -> None:
    """Delete the data of the person with this receipt code.

    Raises NotFoundError if no session has it.

    A receipt code cannot be guessed in fewer than about 2^76 attempts, so they need no limit, and
    nothing is stored of a failed one.

    actor: the experimenter who acts at the person's request; None if the person acts.
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
    """Delete a participant's data at their request, by pseudonym. Raises NotFoundError.

    The audit log records that a participant was deleted, but not which.
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
