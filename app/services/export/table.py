"""The model of exported tables: columns, requests, and queries that several tables share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Select, exists, select
from sqlalchemy.orm import Session, aliased

from app.services.monitoring.data_quality import Flag
from app.services.proposals.people_summaries import PeopleSummaries
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Candidate, Participant, Recording, SessionRow, Trial
from app.study.plan import Plan

from .cells import Value

#: Rows fetched at a time.
_BATCH = 1_000

Row = tuple[Value, ...]


@dataclass(frozen=True)
class Request:
    """The request of an export: one study, and filters on its sessions and trials.

    conditions: only trials under these, and sessions with such a trial; empty: all. since, until:
    first and last day, UTC, on which a session may have begun. without: exclude sessions with one
    of these flags. completed: only completed sessions. left_out: primary keys of the sessions that
    `without` excludes, set by `filters.resolve_flags`. participants: only sessions of these
    pseudonyms; empty: of all. excel: whether tables begin with a byte order mark, by which Excel
    knows UTF-8. people: summaries of people judged together, the process's once
    `filters.resolve_flags` has set them.
    """

    study: StudyInfo
    modes: tuple[str, ...] = ("live",)
    conditions: tuple[str, ...] = ()
    since: date | None = None
    until: date | None = None
    without: tuple[Flag, ...] = ()
    completed: bool = False
    left_out: tuple[int, ...] = ()
    participants: tuple[str, ...] = ()
    excel: bool = False
    people: PeopleSummaries = field(default_factory=PeopleSummaries, compare=False, repr=False)


@dataclass(frozen=True)
class Column:
    """One column. type: string, integer, number, boolean (true, false) or datetime."""

    name: str
    type: str
    unit: str
    description: str


@dataclass(frozen=True)
class Table:
    """One exported table: its columns, and a function that yields its rows."""

    name: str
    description: str
    columns: Callable[[Plan], tuple[Column, ...]]
    rows: Callable[[Session, Request], Iterable[Row]]


def text(name: str, description: str) -> Column:
    """A column of type string."""
    return Column(name, "string", "", description)


def integer(name: str, description: str, unit: str = "") -> Column:
    """A column of type integer."""
    return Column(name, "integer", unit, description)


def number(name: str, description: str, unit: str = "") -> Column:
    """A column of type number."""
    return Column(name, "number", unit, description)


def boolean(name: str, description: str) -> Column:
    """A column of type boolean."""
    return Column(name, "boolean", "", description)


def moment(name: str, description: str) -> Column:
    """A column of type datetime."""
    return Column(name, "datetime", "UTC, ISO 8601", description)


STUDY = text("study", "Slug of the study.")
PLAN_HASH = text("plan_hash", "SHA-256 of the plan, texts and recordings the session ran under.")
PARTICIPANT = text("participant_id", "Pseudonym of the participant.")
SESSION = text("session_id", "Pseudonym of the session: one passage through the study.")
MODE = text("mode", "live, preview, pilot or simulated.")
TRIAL = integer("trial_index", "Number of the trial in the session, from 0; -1 for the practice.")
SURENESS = number(
    "sureness",
    "Probability, by the model, that no candidate is better than it by more than a tenth of the"
    " range, or by the plan's own share (stop: within); none for a knockout.",
)
QUERY = integer("query_index", "Number of the query within the trial, from 0.")


def parameters(plan: Plan, prefix: str, owner: str) -> tuple[Column, ...]:
    """A column for each parameter of the plan. owner: completes "Parameter p of ..."."""
    return tuple(
        Column(
            f"{prefix}{parameter.name}",
            "number",
            parameter.unit or "",
            f"Parameter {parameter.name} of {owner}.",
        )
        for parameter in plan.parameters
    )


def sessions_of(request: Request) -> tuple[ColumnElement[bool], ...]:
    """The conditions that select the requested sessions."""
    holds = [SessionRow.study_id == request.study.id, SessionRow.mode.in_(request.modes)]
    if request.conditions:
        # An alias, because the enclosing statement may select from trials itself.
        trial = aliased(Trial)
        holds.append(
            exists().where(
                trial.session_id == SessionRow.id,
                trial.trial_index >= 0,
                trial.condition.in_(request.conditions),
            )
        )
    if request.since is not None:
        holds.append(SessionRow.started_at >= _midnight(request.since))
    if request.until is not None:
        holds.append(SessionRow.started_at < _midnight(request.until) + timedelta(days=1))
    if request.completed:
        holds.append(SessionRow.stage == "completed")
    if request.participants:
        chosen = select(Participant.id).where(Participant.pseudonym.in_(request.participants))
        holds.append(SessionRow.participant_id.in_(chosen))
    if request.left_out:
        holds.append(SessionRow.id.not_in(request.left_out))
    return tuple(holds)


def trials_of(request: Request) -> tuple[ColumnElement[bool], ...]:
    """The conditions that select the requested trials, in a statement that joins sessions."""
    sessions = sessions_of(request)
    if not request.conditions:
        return sessions
    return *sessions, Trial.condition.in_(request.conditions)


def of_sessions(statement: Select[*tuple[Any, ...]], request: Request) -> Select[*tuple[Any, ...]]:
    """The statement, restricted to the requested sessions."""
    return statement.where(*sessions_of(request))


def of_trials(statement: Select[*tuple[Any, ...]], request: Request) -> Select[*tuple[Any, ...]]:
    """The statement, which joins sessions, restricted to the requested trials."""
    return statement.where(*trials_of(request))


def at_trials_of(
    request: Request, session_id: Any, trial_index: Any
) -> tuple[ColumnElement[bool], ...]:
    """The same for tables that refer to a trial by session and trial index."""
    sessions = sessions_of(request)
    if not request.conditions:
        return sessions
    trial = aliased(Trial)
    return *sessions, exists().where(
        trial.session_id == session_id,
        trial.trial_index == trial_index,
        trial.condition.in_(request.conditions),
    )


def _midnight(day: date) -> datetime:
    return datetime.combine(day, time(), UTC)


def fetch(db: Session, statement: Select[*tuple[Any, ...]]) -> Iterator[Any]:
    """Execute the statement, and iterate over its rows in batches."""
    return iter(db.execute(statement.execution_options(yield_per=_BATCH)))


def points(db: Session, request: Request) -> dict[tuple[str, int], Row]:
    """Parameters of each candidate in the order of the plan, by environment and index."""
    names = [parameter.name for parameter in request.study.plan.parameters]
    return {
        (environment, index): tuple(parameters[name] for name in names)
        for environment, index, parameters in db.execute(
            select(Candidate.environment, Candidate.candidate_index, Candidate.parameters).where(
                Candidate.study_id == request.study.id
            )
        )
    }


def recording_names(db: Session, request: Request) -> dict[int, str]:
    """Names of the study's recordings (see `recording_name`) by primary key."""
    return {
        recording_id: recording_name(environment, index, run)
        for recording_id, environment, index, run in db.execute(
            select(
                Recording.id, Candidate.environment, Candidate.candidate_index, Recording.run_index
            )
            .join(Candidate, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == request.study.id)
        )
    }


def recording_of(names: Mapping[int, str], recording_id: int | None) -> str | None:
    """The name of a query's recording; None while a machine has not recorded it."""
    return None if recording_id is None else names[recording_id]


def recording_name(environment: str, candidate_index: int, run_index: int) -> str:
    """A recording's name in exports, which joins queries.csv to recordings.csv."""
    return f"{environment}-{candidate_index}-{run_index}"
