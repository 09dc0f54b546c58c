"""Undo of a response within some seconds.

The response is kept and marked as undone. Its derived rows and the query that followed it are
deleted, and the session returns to its query.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete, or_
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import TooLateToUndoError
from app.services.studies.repository import stored_plan
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow, UndoneResponse
from app.study import stages
from app.study.stages import Stage

from . import lookup, queries, undo_window
from . import state_view as session_state
from .state_view import State


def undo(app: AppContext, token: str, query_id: str) -> State:
    """Undo the response to this query. A repeated call changes nothing.

    Raises TooLateToUndoError, or OutOfOrder after the trial or the session has moved on.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        query = queries.find(db, session, query_id)
        if query.response is None:
            if queries.was_undone(db, query.public_id):
                return session_state.describe(app, db, session)
            raise TooLateToUndoError("expected an answered query, got an open one", session.stage)
        now = app.now()
        offer = trial = None
        if session.stage == Stage.QUERY:
            trial = queries.load_open_query(db, session, session.trial_index)
            offer = undo_window.find(db, session, trial, now)
        if trial is None or offer is None or offer.query.id != query.id:
            undo_s = stored_plan(session.plan).query.undo_s
            raise TooLateToUndoError(
                f"expected the last response of this trial, given in the last {undo_s} s"
                if undo_s
                else "expected a study that lets responses be taken back, and this one does not",
                session.stage,
            )
        following = queries.find(db, session, trial.public_id)
        lookup.advance(app, session, stages.Undone(query_index=query.query_index))
        _record_undone(db, query, now)
        db.delete(following)
        queries.close_events(db, session, query, "undone")
        db.flush()
        return session_state.describe(app, db, session)


def _record_undone(db: Session, query: QueryRow, now: datetime) -> None:
    """Move the response to the undone ones, and delete its derived rows."""
    assert query.response is not None
    db.add(
        UndoneResponse(
            query_id=query.id,
            response=query.response.response,
            skip_reason=query.response.skip_reason,
            rt_ms=query.response.rt_ms,
            answered_at=query.response.answered_at,
            undone_at=now,
        )
    )
    query.response = None
    here = query.query_index
    # It is the last response, so preferences drawn from it are its own and those of earlier skips.
    derived = or_(PreferenceRow.query_index == here, PreferenceRow.drawn_from_query_index == here)
    db.execute(delete(PreferenceRow).where(PreferenceRow.trial_id == query.trial_id, derived))
    db.execute(
        delete(Acquired).where(Acquired.trial_id == query.trial_id, Acquired.query_index == here)
    )
