"""What exported tables are made of: columns, requests, and what several of them look up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Select, select
from sqlalchemy.orm import Session

from app.services.studies import StudyInfo
from app.storage.tables import (
    Candidate,
    Recording,
    SessionRow,
)
from app.study.plan import Plan

from .cells import Value

#: Rows fetched at a time.
_BATCH = 1_000

Row = tuple[Value, ...]


@dataclass(frozen=True)
class Request:
    """What is asked for: one study, and the modes of the sessions that count."""

    study: StudyInfo
    modes: tuple[str, ...] = ("live",)


@dataclass(frozen=True)
class Column:
    """One column. `type` is string, integer, number, boolean (true, false) or datetime."""

    name: str
    type: str
    unit: str
    description: str


@dataclass(frozen=True)
class Table:
    """One exported file."""

    name: str
    description: str
    columns: Callable[[Plan], tuple[Column, ...]]
    rows: Callable[[Session, Request], Iterable[Row]]


def text(name: str, description: str) -> Column:
    return Column(name, "string", "", description)


def integer(name: str, description: str, unit: str = "") -> Column:
    return Column(name, "integer", unit, description)


def number(name: str, description: str, unit: str = "") -> Column:
    return Column(name, "number", unit, description)


def boolean(name: str, description: str) -> Column:
    return Column(name, "boolean", "", description)


def moment(name: str, description: str) -> Column:
    return Column(name, "datetime", "UTC, ISO 8601", description)


STUDY = text("study", "Slug of the study.")
PLAN_HASH = text("plan_hash", "SHA-256 of the plan, texts and recordings the session ran under.")
PARTICIPANT = text("participant_id", "Pseudonym of the participant.")
SESSION = text("session_id", "Pseudonym of the session: one passage through the study.")
MODE = text("mode", "live, preview or simulated.")
TRIAL = integer("trial_index", "Number of the trial in the session, from 0; -1 for the practice.")
QUERY = integer("query_index", "Number of the query within the trial, from 0.")


def parameters(plan: Plan, prefix: str, whose: str) -> tuple[Column, ...]:
    return tuple(
        number(f"{prefix}{parameter.name}", f"Parameter {parameter.name} of {whose}.", unit)
        for parameter in plan.parameters
        for unit in [parameter.unit or ""]
    )


def sessions_of(request: Request) -> tuple[ColumnElement[bool], ...]:
    """What holds for the sessions that are asked for."""
    return SessionRow.study_id == request.study.id, SessionRow.mode.in_(request.modes)


def of_sessions(statement: Select[*tuple[Any, ...]], request: Request) -> Select[*tuple[Any, ...]]:
    return statement.where(*sessions_of(request))


def fetch(session: Session, statement: Select[*tuple[Any, ...]]) -> Iterator[Any]:
    return iter(session.execute(statement.execution_options(yield_per=_BATCH)))


def points(session: Session, request: Request) -> dict[tuple[str, int], Row]:
    """Parameters of each candidate, by environment and index, in the order of the plan."""
    names = [parameter.name for parameter in request.study.plan.parameters]
    return {
        (environment, index): tuple(parameters[name] for name in names)
        for environment, index, parameters in session.execute(
            select(Candidate.environment, Candidate.candidate_index, Candidate.parameters).where(
                Candidate.study_id == request.study.id
            )
        )
    }


def recording_names(session: Session, request: Request) -> dict[int, str]:
    return {
        recording_id: recording_name(environment, index, run)
        for recording_id, environment, index, run in session.execute(
            select(
                Recording.id, Candidate.environment, Candidate.candidate_index, Recording.run_index
            )
            .join(Candidate, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == request.study.id)
        )
    }


def recording_name(environment: str, candidate_index: int, run_index: int) -> str:
    """A recording's name in exports: it joins queries.csv to recordings.csv."""
    return f"{environment}-{candidate_index}-{run_index}"
