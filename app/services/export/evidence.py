"""Tables of how far what was answered can be relied on: faults, and what the browser saw."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.tables import QueryRow, SessionRow, Trial
from app.study.plan import Plan

from .columns import (
    QUERY,
    SESSION,
    TRIAL,
    Column,
    Request,
    Row,
    Table,
    fetch,
    integer,
    moment,
    of_sessions,
    recording_names,
    text,
)


def _faults_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        QUERY,
        integer("attempt", "Number of the attempt at this query, from 0."),
        text("trial_type", "What kind of query it was; see queries.csv."),
        integer("left_candidate", "Index of the candidate on the left."),
        integer("right_candidate", "Index of the candidate on the right."),
        text("left_recording", "Recording on the left; see recordings.csv."),
        text("right_recording", "Recording on the right; see recordings.csv."),
        moment("shown_at", "When the server first sent it."),
        moment("set_aside_at", "When the fault was reported and another query took its place."),
        text("fault", "What the browser saw of the fault."),
    )


def _faults_rows(session: Session, request: Request) -> Iterator[Row]:
    names = recording_names(session, request)
    statement = of_sessions(
        select(SessionRow.public_id, Trial.trial_index, QueryRow)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(QueryRow.set_aside_at.is_not(None)),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index, QueryRow.attempt)
    for public_id, trial_index, query in fetch(session, statement):
        yield (
            public_id,
            trial_index,
            query.query_index,
            query.attempt,
            query.trial_type,
            query.left_candidate,
            query.right_candidate,
            names[query.left_recording_id],
            names[query.right_recording_id],
            query.shown_at,
            query.set_aside_at,
            query.fault,
        )


FAULTS = Table(
    "faults",
    "Queries set aside because a video did not play: never answered, never learnt from.",
    _faults_columns,
    _faults_rows,
)
