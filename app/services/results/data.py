"""Reads the data of the results: answers and acquired candidates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from app.services.export.table import Request, trials_of
from app.services.proposals.trial_schedule import FILLER
from app.storage.models.studies import Acquired, Participant, QueryRow, Response, SessionRow, Trial
from app.study.attention_checks import Kind

_BATCH = 1_000

#: Types of queries that the method did not propose.
CHECKS: Final = (Kind.REPEAT.value, Kind.ATTENTION.value, FILLER)


class Answer(NamedTuple):
    """One answered query of a trial, not of the practice."""

    session: str
    participant: str
    trial: int
    condition: str
    environment: str
    query: int
    trial_type: str
    left: int
    right: int
    response: str
    rt_ms: float | None

    @property
    def is_check(self) -> bool:
        """Whether the query is a check or a filler, and so not proposed by the method."""
        return self.trial_type in CHECKS


class AcquiredRow(NamedTuple):
    """The acquired candidate after one response that the model learnt from.

    learned: number of such responses in the trial so far, including this one. Responses to checks
    are not among them, unless the plan lets the model learn from checks. sureness: None where the
    trial's model does not say.
    """

    session: str
    participant: str
    trial: int
    condition: str
    environment: str
    finished: bool
    query: int
    candidate: int
    learned: int
    sureness: float | None


def answers(db: Session, request: Request) -> Iterator[Answer]:
    """The answers in the order of sessions, trials and queries."""
    statement = (
        _of_trials(
            request,
            QueryRow.query_index,
            QueryRow.trial_type,
            QueryRow.left_candidate,
            QueryRow.right_candidate,
            Response.response,
            Response.rt_ms,
        )
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(Response, Response.query_id == QueryRow.id)
        .order_by(QueryRow.query_index)
    )
    for row in db.execute(statement):
        yield Answer(*row)


def acquired_rows(db: Session, request: Request) -> Iterator[AcquiredRow]:
    """The acquired candidates, in the order of sessions, trials and queries."""
    statement = (
        _of_trials(
            request,
            Trial.ended_at.is_not(None),
            Acquired.query_index,
            Acquired.candidate,
            Acquired.sureness,
        )
        .join(Acquired, Acquired.trial_id == Trial.id)
        .order_by(Acquired.query_index)
    )
    trial, learned = ("", -1), 0
    for row in db.execute(statement):
        # There is one row for each response that the model learnt from, in order.
        session_id, participant, index, condition, environment, finished, *at = row
        query, candidate, sureness = at
        learned = learned + 1 if trial == (session_id, index) else 1
        trial = session_id, index
        yield AcquiredRow(
            session_id,
            participant,
            index,
            condition,
            environment,
            finished,
            query,
            candidate,
            learned,
            sureness,
        )


def _of_trials(request: Request, *columns: Any) -> Select[Any]:
    """Selects session, trial and condition columns and `columns`, for statements to join to."""
    return (
        select(
            SessionRow.public_id,
            Participant.pseudonym,
            Trial.trial_index,
            Trial.condition,
            Trial.environment,
            *columns,
        )
        .select_from(SessionRow)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .join(Trial, Trial.session_id == SessionRow.id)
        .where(Trial.trial_index >= 0, *trials_of(request))
        .order_by(SessionRow.id, Trial.trial_index)
        .execution_options(yield_per=_BATCH)
    )
