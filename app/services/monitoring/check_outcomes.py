"""Outcomes of repeats and attention checks: the expected response, and the actual one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, and_, select
from sqlalchemy.orm import Session, aliased

from app.services.proposals.attention_checks import GOOD_SIDE
from app.storage.models.studies import QueryRow, Response, SessionRow, Trial
from app.study.attention_checks import Kind

#: The response that agrees with an earlier one when the sides are swapped.
_ON_THE_OTHER_SIDE = {"left": "right", "right": "left", "skip": "skip"}
#: Rows fetched at a time.
_BATCH = 1_000

_GOOD_SIDE_OF = {name: side for side, name in GOOD_SIDE.items()}


@dataclass(frozen=True)
class CheckOutcome:
    """One repeat or attention check that was shown.

    session_key: the session's key in the database. response: None while the query is open.
    passed: None if no particular response is expected, or there is no response yet.
    """

    session_key: int
    session_id: str
    condition: str
    trial_index: int
    query_index: int
    kind: str
    repeats: int | None
    expected: str | None
    response: str | None

    @property
    def passed(self) -> bool | None:
        """Whether the response is the expected one."""
        if self.response is None or self.expected is None:
            return None
        return self.response == self.expected


def check_outcomes(db: Session, *of: ColumnElement[bool]) -> Iterator[CheckOutcome]:
    """The checks of the sessions that satisfy `of`, ordered by session, trial and query."""
    earlier, before = aliased(QueryRow), aliased(Response)
    statement = (
        select(
            SessionRow.id,
            SessionRow.public_id,
            Trial.condition,
            Trial.trial_index,
            QueryRow.query_index,
            QueryRow.trial_type,
            QueryRow.repeats_query_index,
            QueryRow.acquisition,
            Response.response,
            before.response,
        )
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .outerjoin(Response, Response.query_id == QueryRow.id)
        .outerjoin(
            earlier,
            and_(
                earlier.trial_id == QueryRow.trial_id,
                earlier.query_index == QueryRow.repeats_query_index,
                earlier.set_aside_at.is_(None),
            ),
        )
        .outerjoin(before, before.query_id == earlier.id)
        .where(
            QueryRow.trial_type.in_([Kind.REPEAT.value, Kind.ATTENTION.value]),
            QueryRow.set_aside_at.is_(None),
            *of,
        )
        .order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index)
    )
    rows: Any = db.execute(statement.execution_options(yield_per=_BATCH))
    for key, public_id, condition, trial, query, kind, repeats, acquisition, now, then in rows:
        if kind == Kind.ATTENTION:
            expected = _GOOD_SIDE_OF.get(acquisition)
        else:
            expected = _ON_THE_OTHER_SIDE.get(then)
        yield CheckOutcome(key, public_id, condition, trial, query, kind, repeats, expected, now)
