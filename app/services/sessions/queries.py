"""Queries as they are stored: the pair shown, the response, and the client events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session, contains_eager, joinedload

from app.pbbo import EARLIER_PEOPLE_ENGINES, ENGINE_VERSION, defaults_under
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.trial_schedule import AnsweredQueries, AskedQuery
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import stored_plan
from app.storage.bulk_insert import insert_rows
from app.storage.json_rows import AsOneRow
from app.storage.models.studies import Event, QueryRow, Response, SessionRow, Trial, UndoneResponse
from app.study import stages
from app.study.stage_settings import PRACTICE_INDEX
from app.study.stages import ANSWERED, Stage

#: The trial index that stands for the practice in seeds; larger than that of any trial.
_PRACTICE_SEED = 1_000_000


@dataclass(frozen=True)
class ClientEvent:
    """An event in the browser while a query was shown, `time_ms` after the query appeared."""

    event: str
    side: str | None
    time_ms: float
    value: str | None


@dataclass(frozen=True)
class OpenQuery:
    """The state of a trial: its open query, and the queries answered before it."""

    trial_id: int
    trial_index: int
    environment: str
    seed: int
    #: The id of the open query in STATE.
    public_id: str
    attempt: int
    asked: AskedQuery
    record: AnsweredQueries
    #: The query whose response opened this one, if this call stored that response.
    just_answered: QueryRow | None = None


def trial_seed(session: SessionRow, trial_index: int) -> int:
    """The seed of one of the session's trials, or of its practice: 48 bits."""
    own = _PRACTICE_SEED if trial_index == PRACTICE_INDEX else trial_index
    sequence = np.random.SeedSequence([session.seed, own])
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(16))


def trial_spec(
    session: SessionRow, trial_index: int, seed: int, engine_version: str = ENGINE_VERSION
) -> TrialSpec:
    """All inputs of a trial's proposals but the candidates and the history.

    engine_version: the one under which the trial began, as its queries record it. Settings that the
    plan leaves out take the defaults of that version.
    """
    plan = stored_plan(session.plan)
    # The practice uses the environment and the skip button of the first trial.
    condition = plan.conditions[session.trial_conditions[max(trial_index, 0)]]
    # Under these versions shared models did not say how sure they were.
    ends_early = not (condition.is_shared and engine_version in EARLIER_PEOPLE_ENGINES)
    return TrialSpec(
        study_id=session.study_id,
        environment=condition.environment,
        method=condition.method,
        settings=defaults_under(engine_version) | condition.optimizer_settings,
        seed=seed,
        queries=plan.queries_per_trial,
        repeats=plan.repeats_per_trial,
        attention=plan.attention_per_trial,
        checks=plan.checks,
        engine_version=engine_version,
        within=plan.within,
        sure=plan.stop.sure if plan.stop is not None and ends_early else None,
    )


def find(db: Session, session: SessionRow, public_id: str) -> QueryRow:
    """The query of this session with this public id, with its trial and response loaded.

    Raises OutOfOrder if the session's stage has no queries, else NotFoundError if it has no such
    query.
    """
    query = db.scalar(_BY_PUBLIC_ID, {"public_id": public_id, "session_id": session.id})
    if query is None:
        if session.stage not in ANSWERED:
            raise stages.OutOfOrder(Stage(session.stage), "no query is open")
        raise NotFoundError(f"this session has no query {public_id!r}")
    return query


def load_open_query(db: Session, session: SessionRow, trial_index: int) -> OpenQuery:
    """The open query of a session's trial, or of its practice, with the history before it."""
    found = _OPEN_QUERY.read(db, {"session_id": session.id, "trial_index": trial_index})
    *before, last = sorted(found, key=lambda one: one[_LEADING_COLUMNS])
    trial_id, environment, seed, public_id, attempt, *asked = last
    return OpenQuery(
        trial_id=trial_id,
        trial_index=trial_index,
        environment=environment,
        seed=seed,
        public_id=public_id,
        attempt=attempt,
        asked=AskedQuery(*asked),
        record=tuple(AskedQuery(*answered[_LEADING_COLUMNS:]) for answered in before),
    )


def previous_query(db: Session, open_query: OpenQuery) -> QueryRow | None:
    """The query before the open one, with its response; None if there is none."""
    place = {"trial_id": open_query.trial_id, "query_index": open_query.asked.query_index - 1}
    return db.scalar(_ANSWERED, place)


def was_undone(db: Session, public_id: str) -> bool:
    """Whether a response to this query was ever undone."""
    return db.scalar(_UNDONE, {"public_id": public_id}) is not None


def read_record(db: Session, trial_id: int) -> AnsweredQueries:
    """The answered queries of one trial, in order."""
    shown = (AskedQuery(*row) for row in _RECORD.read(db, {"trial_id": trial_id}))
    return tuple(sorted(shown, key=lambda one: one.query_index))


def read_attempts(db: Session, query: QueryRow) -> AnsweredQueries:
    """All attempts at this query's index, including those set aside, oldest first."""
    rows: Iterable[Any] = db.execute(
        select(*_ASKED_COLUMNS)
        .where(QueryRow.trial_id == query.trial_id, QueryRow.query_index == query.query_index)
        .order_by(QueryRow.attempt)
    )
    return tuple(AskedQuery(*(*row, None)) for row in rows)


def number_set_aside(db: Session, session: SessionRow) -> int:
    """The number of this session's queries that were set aside."""
    statement = (
        select(func.count(QueryRow.id))
        .join(Trial, QueryRow.trial_id == Trial.id)
        .where(Trial.session_id == session.id, QueryRow.set_aside_at.is_not(None))
    )
    return db.scalar(statement) or 0


def store_events(
    db: Session, session: SessionRow, query: QueryRow, client_events: Iterable[ClientEvent]
) -> None:
    """Insert client events of a query. `event_limits.store` applies the limits."""
    seen = [
        {
            "session_id": session.id,
            "trial_index": query.trial.trial_index,
            "query_index": query.query_index,
            "event": event.event,
            "side": event.side,
            "time_ms": event.time_ms,
            "value": event.value,
        }
        for event in client_events
    ]
    insert_rows(db, Event, seen)


def close_events(db: Session, session: SessionRow, query: QueryRow, why: str) -> None:
    """Add an event `why` that ends the events so far, which do not belong to the final response."""
    last = db.scalar(
        select(func.max(Event.time_ms)).where(
            Event.session_id == session.id,
            Event.trial_index == query.trial.trial_index,
            Event.query_index == query.query_index,
        )
    )
    store_events(db, session, query, [ClientEvent(why, None, last or 0.0, None)])


_ASKED_COLUMNS: tuple[Any, ...] = (
    QueryRow.query_index,
    QueryRow.trial_type,
    QueryRow.left_candidate,
    QueryRow.right_candidate,
    QueryRow.left_recording_id,
    QueryRow.right_recording_id,
    QueryRow.acquisition,
    QueryRow.engine_version,
    QueryRow.repeats_query_index,
)

# Built once: for such small queries, building the statement takes as long as executing it.
_BY_PUBLIC_ID = (
    select(QueryRow)
    .join(Trial, QueryRow.trial_id == Trial.id)
    .where(
        QueryRow.public_id == bindparam("public_id"), Trial.session_id == bindparam("session_id")
    )
    .options(contains_eager(QueryRow.trial), joinedload(QueryRow.response))
)
_ANSWERED = (
    select(QueryRow)
    .join(QueryRow.response)
    .where(
        QueryRow.trial_id == bindparam("trial_id"), QueryRow.query_index == bindparam("query_index")
    )
    .options(contains_eager(QueryRow.response))
)
_UNDONE = (
    select(UndoneResponse.id)
    .join(QueryRow, QueryRow.id == UndoneResponse.query_id)
    .where(QueryRow.public_id == bindparam("public_id"))
    .limit(1)
)
#: Columns before those of `Shown` in the rows of `_OPEN_QUERY`.
_TRIAL_COLUMNS: tuple[Any, ...] = (Trial.id, Trial.environment, Trial.seed)
_QUERY_COLUMNS: tuple[Any, ...] = (QueryRow.public_id, QueryRow.attempt)
_LEADING_COLUMNS = len(_TRIAL_COLUMNS) + len(_QUERY_COLUMNS)
_OPEN_QUERY = AsOneRow(
    select(
        *_TRIAL_COLUMNS, *_QUERY_COLUMNS, *_ASKED_COLUMNS, Response.response, Response.skip_reason
    )
    .join(QueryRow, QueryRow.trial_id == Trial.id)
    .outerjoin(Response, Response.query_id == QueryRow.id)
    .where(
        Trial.session_id == bindparam("session_id"),
        Trial.trial_index == bindparam("trial_index"),
        QueryRow.set_aside_at.is_(None),
    )
)
_RECORD = AsOneRow(
    select(*_ASKED_COLUMNS, Response.response, Response.skip_reason)
    .join(Response, Response.query_id == QueryRow.id)
    .where(QueryRow.trial_id == bindparam("trial_id"))
)
