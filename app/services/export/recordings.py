"""The table of recordings, with their candidates and parameters."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Candidate, Recording
from app.study.plan import Plan

from .table import (
    Column,
    Request,
    Row,
    Table,
    fetch,
    integer,
    number,
    parameters,
    points,
    recording_name,
    text,
)


def _recordings_columns(plan: Plan) -> tuple[Column, ...]:
    return (
        text("recording", "Name of the recording in queries.csv."),
        text("environment", "Environment of the candidate."),
        integer("candidate", "Index of the candidate."),
        *parameters(plan, "", "the candidate"),
        integer("run", "Number of the recording of its candidate, from 0."),
        text("source", "crane: rendered; file: a video of the study's own, or of a machine."),
        text("file", "The study's own file, as recordings.csv of its folder names it."),
        number("duration_s", "Length of the video.", "s"),
        number("score", "Score of the run, where it has one; never shown to anybody."),
        text("public_id", "What a browser knows the recording as."),
        text("rollout", "Rollout that it was made by, see rollouts.csv; none where it was given."),
        text("machine", "Machine that recorded it; none where it was given."),
    )


def _recordings_rows(db: Session, request: Request) -> Iterator[Row]:
    by_candidate = points(db, request)
    statement = (
        select(
            Candidate.environment,
            Candidate.candidate_index,
            Recording,
            Rollout.public_id,
            Machine.name,
        )
        .join(Candidate, Recording.candidate_id == Candidate.id)
        .outerjoin(Rollout, Rollout.recording_id == Recording.id)
        .outerjoin(Machine, Rollout.machine_id == Machine.id)
        .where(Candidate.study_id == request.study.id)
        .order_by(Candidate.environment, Candidate.candidate_index, Recording.run_index)
    )
    for environment, index, row, rollout, machine in fetch(db, statement):
        yield (
            recording_name(environment, index, row.run_index),
            environment,
            index,
            *by_candidate[environment, index],
            row.run_index,
            row.source,
            row.file,
            row.duration_s,
            row.score,
            row.public_id,
            rollout,
            machine,
        )


RECORDINGS = Table(
    "recordings", "Every recording of the study.", _recordings_columns, _recordings_rows
)
