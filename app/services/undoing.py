"""Taking a response back, for some seconds after it was given.

What was pressed is kept, marked as taken back; what it taught is gone, and so is the query that
followed from it. The session is back at its query.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete, or_
from sqlalchemy.orm import Session

from app.storage.tables import Acquired, PreferenceRow, QueryRow, UndoneResponse
from app.study import protocol
from app.study.protocol import Stage

from . import queries, sessions, undo_offer
from . import state as session_state
from .errors import TooLateToUndoError
from .state import State
from .studies import stored_plan
from .studio import Studio


def undo(studio: Studio, token: str, query_id: str) -> State:
    """Take back the response to this query. The same again changes nothing.

    Raises TooLateToUndoError, or OutOfOrder once the trial or the session has moved on.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        query = queries.find(session, row, query_id)
        if query.response is None:
            if queries.was_undone(session, query.public_id):
                return session_state.describe(studio, session, row)
            raise TooLateToUndoError("expected an answered query, got an open one", row.stage)
        now = studio.now()
        offer = trial = None
        if row.stage == Stage.QUERY:
            trial = queries.standing(session, row, row.trial_index)
            offer = undo_offer.find(session, row, trial, now)
        if trial is None or offer is None or offer.query.id != query.id:
            undo_s = stored_plan(row.plan).query.undo_s
            raise TooLateToUndoError(
                f"expected the last response of this trial, given in the last {undo_s} s"
                if undo_s
                else "expected a study that lets responses be taken back, and this one does not",
                row.stage,
            )
        following = queries.find(session, row, trial.public_id)
        sessions.advance(studio, row, protocol.Undone(query_index=query.query_index))
        _take_back(session, query, now)
        session.delete(following)
        queries.close_events(session, row, query, "undone")
        session.flush()
        return session_state.describe(studio, session, row)


def _take_back(session: Session, query: QueryRow, now: datetime) -> None:
    assert query.response is not None
    session.add(
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
    # It is the last response: what was drawn from it is what skips before it had waited for.
    taught = or_(PreferenceRow.query_index == here, PreferenceRow.drawn_from_query_index == here)
    session.execute(delete(PreferenceRow).where(PreferenceRow.trial_id == query.trial_id, taught))
    session.execute(
        delete(Acquired).where(Acquired.trial_id == query.trial_id, Acquired.query_index == here)
    )
