"""An evaluator's passage through a study. The server alone decides where a session is.

Each use case reads, works out what follows outside any transaction, and then writes once, having
looked again: two tabs, a double click or a retry find that it was done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session, contains_eager, joinedload

from app.pbbo import allows_skip
from app.storage.tables import (
    Acquired,
    Event,
    PreferenceRow,
    QueryRow,
    Response,
    SessionRow,
    Trial,
)
from app.study import protocol
from app.study.protocol import Stage

from . import playlist, sessions, trials
from . import state as session_state
from .errors import (
    AlreadyAnsweredError,
    NotFoundError,
    SkipNotOfferedError,
)
from .proposals import Step
from .state import State
from .studio import Studio


@dataclass(frozen=True)
class Happening:
    """Something the browser saw while a query was on the screen, `time_ms` after it appeared."""

    event: str
    side: str | None
    time_ms: float
    value: str | None


@dataclass(frozen=True)
class Answer:
    """What was pressed, and what the browser saw meanwhile."""

    query_id: str
    response: str
    rt_ms: float | None = None
    skip_reason: str | None = None
    happenings: Sequence[Happening] = ()


def current(studio: Studio, token: str) -> State:
    """Where the session is."""
    with studio.database.read() as session:
        return session_state.describe(studio, session, sessions.find(studio, session, token))


def consent(studio: Studio, token: str, version: str) -> State:
    """Agree to the consent of `version`. Raises StaleConsent if the text is another one now."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        written = row.plan.texts[row.language]
        now_in_force = session_state.consent_text(written)["version"]
        event = protocol.Consented(version=version, current_version=now_in_force)
        sessions.advance(studio, row, event)
        row.consent_version = version
        row.consented_at = studio.now()
        state = session_state.describe(studio, session, row)
        first = trials.first_query(studio, row)
        coming = [first.left, first.right, *playlist.clips(studio, row)]
    studio.proposer.render(coming)
    return state


def go_on(studio: Studio, token: str) -> State:
    """Leave a page that only has to be left. Raises OutOfOrder, or BreakNotOver."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        watched = len(playlist.watched(row)) if row.stage == Stage.FAMILIARISATION else 0
        sessions.advance(studio, row, protocol.Continued(at=studio.now(), watched=watched))
        trials.arrive(studio, session, row)
        return session_state.describe(studio, session, row)


def watch(studio: Studio, token: str, index: int) -> State:
    """A video of the familiarisation was watched to its end. The same again changes nothing."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        if row.stage != Stage.FAMILIARISATION:
            raise protocol.OutOfOrder(Stage(row.stage), "no video is to be watched now")
        playlist.mark_watched(row, index)
        row.last_seen_at = studio.now()
        return session_state.describe(studio, session, row)


def respond(studio: Studio, token: str, answer: Answer) -> State:
    """Store a response and move on. The same response again changes nothing."""
    with studio.database.read() as session:
        row = sessions.find(studio, session, token)
        query = _query_of(session, row, answer.query_id)
        if not _is_new(row, query, answer):
            return session_state.describe(studio, session, row)
        trial = session_state.trial_in_hand(row, query.trial.trial_index, query.trial.seed)
        if answer.response == "skip" and not allows_skip(trial.method):
            raise SkipNotOfferedError(
                "expected left or right: this query offers no skip", row.stage
            )
        history = session_state.read_history(session, query.trial_id)
    # The fit, if it was not worked out ahead: between two transactions, inside none.
    pressed = (query.left_candidate, query.right_candidate, answer.response)
    step = studio.proposer.step(trial, (*history, pressed))

    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        query = _query_of(session, row, answer.query_id)
        if not _is_new(row, query, answer):
            return session_state.describe(studio, session, row)
        now = studio.now()
        # Raises if another query is the open one: nothing has been written yet.
        sessions.advance(studio, row, protocol.Responded(query_index=query.query_index, at=now))
        _store(session, row, query, answer, now)
        _store_lessons(session, query, step)
        if row.stage == Stage.QUERY and row.trial_index == query.trial.trial_index:
            assert step.next is not None
            session.add(trials.query_row(step.next, now, trial_id=query.trial_id))
        else:
            query.trial.ended_at = now
            trials.arrive(studio, session, row)
        session.flush()
        return session_state.describe(studio, session, row)


def _query_of(session: Session, row: SessionRow, public_id: str) -> QueryRow:
    query = session.scalar(
        select(QueryRow)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .where(QueryRow.public_id == public_id, Trial.session_id == row.id)
        .options(contains_eager(QueryRow.trial), joinedload(QueryRow.response))
    )
    if query is None:
        if row.stage != Stage.QUERY:
            raise protocol.OutOfOrder(Stage(row.stage), "no query is open")
        raise NotFoundError(f"this session has no query {public_id!r}")
    return query


def _is_new(row: SessionRow, query: QueryRow, answer: Answer) -> bool:
    """Whether the query is still to be answered; raises if it was answered otherwise."""
    if query.response is None:
        return True
    if query.response.response != answer.response:
        raise AlreadyAnsweredError(
            f"expected {query.response.response!r} again, the response this query has, "
            f"got {answer.response!r}",
            row.stage,
        )
    return False


def _store(
    session: Session, row: SessionRow, query: QueryRow, answer: Answer, now: datetime
) -> None:
    query.response = Response(
        response=answer.response,
        skip_reason=answer.skip_reason,
        rt_ms=answer.rt_ms,
        answered_at=now,
    )
    session.add_all(
        Event(
            session_id=row.id,
            trial_index=query.trial.trial_index,
            query_index=query.query_index,
            event=happening.event,
            side=happening.side,
            time_ms=happening.time_ms,
            value=happening.value,
        )
        for happening in answer.happenings
    )


def _store_lessons(session: Session, query: QueryRow, step: Step) -> None:
    """Store what the response taught: the preferences that are new, and w_acq."""
    known = session.scalar(
        select(func.count(PreferenceRow.id)).where(PreferenceRow.trial_id == query.trial_id)
    )
    for index, preference in enumerate(step.preferences[known:], start=known or 0):
        session.add(
            PreferenceRow(
                trial_id=query.trial_id,
                preference_index=index,
                winner=preference.winner,
                loser=preference.loser,
                origin=preference.origin,
                query_index=preference.query_index,
                drawn_from_query_index=preference.drawn_from_query_index,
            )
        )
    if step.acquired is not None:
        session.add(
            Acquired(
                trial_id=query.trial_id,
                query_index=query.query_index,
                candidate=step.acquired.candidate,
                posterior_mean=step.acquired.mean,
                posterior_std=step.acquired.std,
            )
        )
