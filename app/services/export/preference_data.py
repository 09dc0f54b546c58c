"""The training data of each trial's model: points, and pairwise comparisons of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.studies import Participant, PreferenceRow, SessionRow, Trial

from .table import Request, fetch, points, trials_of


@dataclass(frozen=True)
class LearntTrial:
    """The training data of one trial: n points and m comparisons, in the order of learning.

    candidates: (n,), the candidate index of each point, ascending. datapoints: (n, d), their
    parameters in the order of the plan. comparisons: (m, 2), rows of datapoints, the preferred one
    first. origins: (m,), "answer" or "synthesis". query_indices: (m,), the query of each.
    """

    session_id: str
    participant_id: str
    mode: str
    trial_index: int
    condition: str
    method: str
    environment: str
    candidates: list[int]
    datapoints: list[list[float]]
    comparisons: list[list[int]]
    origins: list[str]
    query_indices: list[int]


def learnt_trials(db: Session, request: Request) -> Iterator[LearntTrial]:
    """The training data of the requested trials by session and trial, without the practice."""
    by_candidate = points(db, request)
    statement = (
        select(SessionRow.public_id, Participant.pseudonym, SessionRow.mode, Trial, PreferenceRow)
        .select_from(SessionRow)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .join(Trial, Trial.session_id == SessionRow.id)
        .outerjoin(PreferenceRow, PreferenceRow.trial_id == Trial.id)
        .where(Trial.trial_index >= 0, *trials_of(request))
        .order_by(SessionRow.id, Trial.trial_index, PreferenceRow.preference_index)
    )

    def of_trial(row: Any) -> int:
        key: int = row[3].id
        return key

    for _, rows in groupby(fetch(db, statement), key=of_trial):
        found = list(rows)
        session_id, participant, mode, trial, _preference = found[0]
        learnt = [row[4] for row in found if row[4] is not None]
        known = sorted({index for each in learnt for index in (each.winner, each.loser)})
        place = {candidate: row for row, candidate in enumerate(known)}
        where = trial.environment
        yield LearntTrial(
            session_id=session_id,
            participant_id=participant,
            mode=mode,
            trial_index=trial.trial_index,
            condition=trial.condition,
            method=trial.method,
            environment=where,
            candidates=known,
            datapoints=[_numbers(by_candidate[where, candidate]) for candidate in known],
            comparisons=[[place[each.winner], place[each.loser]] for each in learnt],
            origins=[each.origin for each in learnt],
            query_indices=[each.query_index for each in learnt],
        )


def _numbers(values: tuple[Any, ...]) -> list[float]:
    return [float(value) for value in values]
