"""The table of trials, and the condition of a trial for tables that refer to one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sqlalchemy import case, func, select
from sqlalchemy.orm import Session

from app.storage.models.studies import (
    Acquired,
    Participant,
    PlanVersion,
    QueryRow,
    Response,
    SessionRow,
    Trial,
)
from app.study.plan import Plan

from .table import (
    MODE,
    PARTICIPANT,
    PLAN_HASH,
    SESSION,
    STUDY,
    SURENESS,
    TRIAL,
    Column,
    Request,
    Row,
    Table,
    fetch,
    integer,
    moment,
    number,
    of_sessions,
    parameters,
    points,
    text,
    trials_of,
)

CONDITION = text("condition", "Name of the condition that the trial was run under.")


def _columns(plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        PLAN_HASH,
        PARTICIPANT,
        SESSION,
        MODE,
        integer("trial_index", "Number of the trial in the session, from 0."),
        CONDITION,
        text("method", "Method that chose the queries."),
        text("environment", "Environment of the candidates."),
        integer("seed", "Seed of the trial's proposals."),
        moment("started_at", "When the trial began."),
        moment("ended_at", "When its last response was stored; empty while it is under way."),
        integer("responses", "Responses so far, skips and checks included."),
        integer("skips", "How many of them were skips."),
        integer("candidate", "Index of the candidate that is acquired so far."),
        *parameters(plan, "", "the acquired candidate"),
        number("posterior_mean", "Posterior mean of the acquired candidate; none for a knockout."),
        number("posterior_std", "Posterior standard deviation of the same."),
        SURENESS,
    )


def _rows(db: Session, request: Request) -> Iterator[Row]:
    by_candidate = points(db, request)
    responses = (
        select(
            QueryRow.trial_id,
            func.count(Response.id).label("responses"),
            func.sum(case((Response.response == "skip", 1), else_=0)).label("skips"),
        )
        .join(Response, Response.query_id == QueryRow.id)
        .where(QueryRow.set_aside_at.is_(None))
        .group_by(QueryRow.trial_id)
        .subquery()
    )
    last = (
        select(Acquired.trial_id, func.max(Acquired.query_index).label("query_index"))
        .group_by(Acquired.trial_id)
        .subquery()
    )
    statement = (
        select(
            Trial,
            SessionRow,
            Participant.pseudonym,
            PlanVersion.plan_hash,
            responses.c.responses,
            responses.c.skips,
            Acquired,
        )
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .join(PlanVersion, SessionRow.plan_id == PlanVersion.id)
        .outerjoin(responses, responses.c.trial_id == Trial.id)
        .outerjoin(last, last.c.trial_id == Trial.id)
        .outerjoin(
            Acquired,
            (Acquired.trial_id == Trial.id) & (Acquired.query_index == last.c.query_index),
        )
        .where(Trial.trial_index >= 0, *trials_of(request))
        .order_by(SessionRow.id, Trial.trial_index)
    )
    unknown = (None,) * len(request.study.plan.parameters)
    for trial, row, pseudonym, plan_hash, answered, skips, acquired in fetch(db, statement):
        yield (
            request.study.slug,
            plan_hash,
            pseudonym,
            row.public_id,
            row.mode,
            trial.trial_index,
            trial.condition,
            trial.method,
            trial.environment,
            trial.seed,
            trial.started_at,
            trial.ended_at,
            answered or 0,
            skips or 0,
            acquired.candidate if acquired else None,
            *(by_candidate[trial.environment, acquired.candidate] if acquired else unknown),
            acquired.posterior_mean if acquired else None,
            acquired.posterior_std if acquired else None,
            acquired.sureness if acquired else None,
        )


TRIALS = Table(
    "trials",
    "One row per trial: its condition, when it began and ended, and what was acquired.",
    _columns,
    _rows,
)


def with_condition(table: Table, *, has_practice: bool = True) -> Table:
    """The table with the trial's condition after its `trial_index`.

    has_practice: whether an index of -1 is the practice; otherwise it belongs to no trial.
    """

    def columns(plan: Plan) -> tuple[Column, ...]:
        before = table.columns(plan)
        at = _place(before)
        return (*before[:at], CONDITION, *before[at:])

    def rows(db: Session, request: Request) -> Iterator[Row]:
        before = table.columns(request.study.plan)
        at, session = _place(before), [column.name for column in before].index(SESSION.name)
        conditions = _conditions(db, request)
        for row in table.rows(db, request):
            index: Any = row[at - 1]
            is_trial = index is not None and (index >= 0 or has_practice)
            named = conditions.get((str(row[session]), index)) if is_trial else None
            yield (*row[:at], named, *row[at:])

    return Table(table.name, table.description, columns, rows)


def _place(columns: tuple[Column, ...]) -> int:
    return [column.name for column in columns].index(TRIAL.name) + 1


def _conditions(db: Session, request: Request) -> dict[tuple[str, int], str]:
    """The condition of each trial by session and index."""
    statement = of_sessions(
        select(SessionRow.public_id, Trial.trial_index, Trial.condition).join(
            Trial, Trial.session_id == SessionRow.id
        ),
        request,
    )
    return {(session_id, index): condition for session_id, index, condition in fetch(db, statement)}
