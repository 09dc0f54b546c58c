"""The table of rollouts: what machines were asked to run, and what became of it."""

from __future__ import annotations

import json
from collections.abc import Iterator

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Candidate
from app.study.plan import Plan

from .table import (
    Column,
    Request,
    Row,
    Table,
    fetch,
    integer,
    moment,
    number,
    parameters,
    points,
    recording_name,
    text,
)


def _columns(plan: Plan) -> tuple[Column, ...]:
    return (
        text("rollout", "Id of the rollout."),
        text("environment", "Environment in which the machine ran."),
        integer("candidate", "Index of the candidate."),
        *parameters(plan, "", "the candidate"),
        integer("run", "Number of the run among those of its candidate, from 0."),
        integer("seed", "Seed that the machine was given."),
        text("asked_for", "query: a pair waited for it; ahead: perhaps needed next; acquired."),
        integer("priority", "The smallest number was run first."),
        text("outcome", "asked, claimed, recorded, failed, unsafe, cancelled or withdrawn."),
        text("machine", "Machine that has or had it last."),
        integer("attempts", "How often a machine has claimed it."),
        moment("asked_at", "When it was asked."),
        moment("claimed_at", "When it was last claimed."),
        moment("ended_at", "When it ended."),
        text("reason", "Why it failed, was unsafe, or was cancelled or withdrawn."),
        text("failures", "Attempts that failed, as JSON: attempt, machine, time and reason."),
        text("recording", "Name of its recording in recordings.csv and queries.csv."),
        text("sha256", "SHA-256 of the bytes that the machine sent."),
        number("score", "The machine's own number; never shown, and never learnt from."),
        text("series", "The machine's own numbers, as JSON."),
    )


def _rows(db: Session, request: Request) -> Iterator[Row]:
    by_candidate = points(db, request)
    statement = (
        select(Rollout, Candidate.candidate_index, Machine.name)
        .join(Candidate, Rollout.candidate_id == Candidate.id)
        .outerjoin(Machine, Rollout.machine_id == Machine.id)
        .where(Rollout.study_id == request.study.id)
        .order_by(Rollout.id)
    )
    for row, index, machine in fetch(db, statement):
        yield (
            row.public_id,
            row.environment,
            index,
            *by_candidate[row.environment, index],
            row.run_index,
            row.seed,
            row.reason,
            row.priority,
            row.status,
            machine,
            row.attempt,
            row.asked_at,
            row.claimed_at,
            row.ended_at,
            row.explanation,
            json.dumps(row.failures) if row.failures else None,
            None
            if row.recording_id is None
            else recording_name(row.environment, index, row.run_index),
            row.sha256,
            row.score,
            None if row.series is None else json.dumps(row.series, separators=(",", ":")),
        )


ROLLOUTS = Table(
    "rollouts",
    "What machines were asked to run, when, and what became of it.",
    _columns,
    _rows,
)
