"""Tables on the reliability of the answers: faults, checks, and undone responses."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.monitoring.check_outcomes import check_outcomes
from app.storage.models.studies import QueryRow, SessionRow, Trial, UndoneResponse
from app.study.plan import Plan

from .table import (
    QUERY,
    SESSION,
    TRIAL,
    Column,
    Request,
    Row,
    Table,
    boolean,
    fetch,
    integer,
    moment,
    number,
    of_trials,
    recording_names,
    recording_of,
    text,
    trials_of,
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


def _faults_rows(db: Session, request: Request) -> Iterator[Row]:
    names = recording_names(db, request)
    statement = of_trials(
        select(SessionRow.public_id, Trial.trial_index, QueryRow)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(QueryRow.set_aside_at.is_not(None)),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index, QueryRow.attempt)
    for public_id, trial_index, query in fetch(db, statement):
        yield (
            public_id,
            trial_index,
            query.query_index,
            query.attempt,
            query.trial_type,
            query.left_candidate,
            query.right_candidate,
            recording_of(names, query.left_recording_id),
            recording_of(names, query.right_recording_id),
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


def _checks_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        QUERY,
        text("check", "repeat or attention."),
        integer("repeats_query_index", "For a repeat: the query that is shown again."),
        text("expected", "The response that agrees: with the earlier one, or with what is known."),
        text("response", "left, right, skip, or empty while the query is open."),
        boolean("passed", "Whether the response is the one expected."),
    )


def _checks_rows(db: Session, request: Request) -> Iterator[Row]:
    for outcome in check_outcomes(db, *trials_of(request)):
        yield (
            outcome.session_id,
            outcome.trial_index,
            outcome.query_index,
            outcome.kind,
            outcome.repeats,
            outcome.expected,
            outcome.response,
            outcome.passed,
        )


CHECKS = Table(
    "checks",
    "Repeats and attention checks, and whether they were passed.",
    _checks_columns,
    _checks_rows,
)


def _undone_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        QUERY,
        text("response", "What was pressed: left, right, skip."),
        text("skip_reason", "Reason given for a skip, where the study asks for one."),
        number("rt", "Time from both videos having begun to play to the response.", "ms"),
        moment("answered_at", "When the server stored the response."),
        moment("undone_at", "When it was taken back."),
    )


def _undone_rows(db: Session, request: Request) -> Iterator[Row]:
    statement = of_trials(
        select(SessionRow.public_id, Trial.trial_index, QueryRow.query_index, UndoneResponse)
        .join(QueryRow, UndoneResponse.query_id == QueryRow.id)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index, UndoneResponse.id)
    for public_id, trial_index, query_index, undone in fetch(db, statement):
        yield (
            public_id,
            trial_index,
            query_index,
            undone.response,
            undone.skip_reason,
            undone.rt_ms,
            undone.answered_at,
            undone.undone_at,
        )


UNDONE = Table(
    "undone",
    "Responses that were taken back at once: kept for the record, never learnt from.",
    _undone_columns,
    _undone_rows,
)
