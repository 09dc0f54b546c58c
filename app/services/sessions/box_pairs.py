"""Opens queries over a search space: binds recordings that exist, and asks machines for others.

A query is stored with its pair before its videos exist. It is bound to rollouts and recordings,
never to parameters: two runs of a machine differ.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Final

import numpy as np
from sqlalchemy import exists, or_, select
from sqlalchemy.orm import Session

from app.services.proposals.trial_schedule import AskedQuery
from app.services.rollouts import lookup as rollouts
from app.services.rollouts import requests, states
from app.services.runtime.ids import new_public_id
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, QueryRow

from .box_trials import BoxTrial, Sources

#: Priorities of rollouts, the smallest first: what a query waits for, what may come next (plus its
#: rank among the possible pairs). What shows an acquired candidate comes between them.
QUERY_PRIORITY: Final = 0
AHEAD_PRIORITY: Final = 10

#: Separates the seeds of runs from the other uses of a trial's seed.
_RUN_DRAW: Final = 109


@dataclass(frozen=True)
class Pair:
    """A query to open.

    left, right: rows of candidates. sources: what it was proposed from; None for a repeat. repeats:
    index of the query that it shows again.
    """

    query_index: int
    trial_type: str
    left: Candidate
    right: Candidate
    acquisition: str
    sources: Sources | None
    repeats: int | None = None


def open_pair(
    db: Session,
    trial: BoxTrial,
    trial_id: int,
    pair: Pair,
    now: datetime,
    *,
    attempt: int = 0,
    earlier: QueryRow | None = None,
) -> QueryRow:
    """Store the query, with recordings as far as they exist, and ask for the others.

    earlier: the query that a repeat shows again, from whose recordings it is shown.
    """
    row = QueryRow(
        trial_id=trial_id,
        public_id=new_public_id(),
        query_index=pair.query_index,
        attempt=attempt,
        trial_type=pair.trial_type,
        left_candidate=pair.left.candidate_index,
        right_candidate=pair.right.candidate_index,
        acquisition=pair.acquisition,
        seed=trial.spec.seed,
        engine_version=trial.spec.engine_version,
        repeats_query_index=pair.repeats,
        created_at=now,
    )
    if pair.sources is not None:
        row.proposed_from = pair.sources.as_json()
    if earlier is not None:
        row.left_rollout_id, row.right_rollout_id = (
            earlier.right_rollout_id,
            earlier.left_rollout_id,
        )
        row.left_recording_id, row.right_recording_id = (
            earlier.right_recording_id,
            earlier.left_recording_id,
        )
    else:
        sides = (pair.left, pair.right)
        left, right = _rollouts(db, trial, trial_id, pair.query_index, sides, now)
        row.left_rollout_id, row.right_rollout_id = left.id, right.id
        row.left_recording_id, row.right_recording_id = left.recording_id, right.recording_id
    if row.left_recording_id is not None and row.right_recording_id is not None:
        row.shown_at = now
    db.add(row)
    db.flush()
    return row


def ask_ahead(
    db: Session,
    trial: BoxTrial,
    trial_id: int | None,
    query_index: int,
    candidates: Iterable[Candidate],
    now: datetime,
) -> list[int]:
    """Ask for recordings that the query at this index may need, each candidate once.

    candidates: the likeliest first; at most `ahead` of those without a recording are asked for.
    Returns the ids of the rows of the candidates asked for.
    """
    distinct = list({candidate.id: candidate for candidate in candidates}.values())
    recorded = usable_recordings(db, trial, [candidate.id for candidate in distinct])
    wanted = [candidate for candidate in distinct if candidate.id not in recorded]
    wanted = wanted[: trial.rollout.ahead]
    # In the order of ids, so that two transactions that ask for the same ones cannot deadlock.
    for rank, candidate in sorted(enumerate(wanted), key=lambda one: one[1].id):
        requests.ask(
            db,
            study_id=trial.spec.study_id,
            candidate=candidate,
            environment=trial.spec.environment,
            reason=requests.AHEAD,
            priority=AHEAD_PRIORITY + rank,
            trial_id=trial_id,
            now=now,
            seed=_run_seed(trial, query_index, candidate),
        )
    return [candidate.id for candidate in wanted]


def usable_recordings(
    db: Session, trial: BoxTrial, candidate_ids: Collection[int]
) -> Mapping[int, Rollout]:
    """The recorded rollouts that may be shown for these candidates (ids of rows).

    Without `reuse`, only rollouts that no query has shown yet.
    """
    if trial.rollout.reuse:
        return rollouts.newest_recorded(db, candidate_ids)
    is_shown = exists().where(
        or_(QueryRow.left_rollout_id == Rollout.id, QueryRow.right_rollout_id == Rollout.id)
    )
    rows = db.scalars(
        select(Rollout)
        .where(
            Rollout.candidate_id.in_(candidate_ids),
            Rollout.status == states.RECORDED,
            ~is_shown,
        )
        .order_by(Rollout.run_index)
    )
    return {rollout.candidate_id: rollout for rollout in rows}


def as_asked(row: QueryRow) -> AskedQuery:
    """An open query of these columns."""
    return AskedQuery(
        query_index=row.query_index,
        trial_type=row.trial_type,
        left=row.left_candidate,
        right=row.right_candidate,
        left_recording=row.left_recording_id,
        right_recording=row.right_recording_id,
        acquisition=row.acquisition,
        engine_version=row.engine_version,
        repeats=row.repeats_query_index,
        response=None,
    )


def _rollouts(
    db: Session,
    trial: BoxTrial,
    trial_id: int,
    query_index: int,
    sides: tuple[Candidate, Candidate],
    now: datetime,
) -> tuple[Rollout, Rollout]:
    """The rollouts of both sides: recorded ones that may be shown, or else outstanding ones."""
    found = dict(usable_recordings(db, trial, [candidate.id for candidate in sides]))
    # In the order of ids, so that two transactions that ask for the same ones cannot deadlock.
    for candidate in sorted(sides, key=lambda candidate: candidate.id):
        if candidate.id not in found:
            found[candidate.id] = requests.ask(
                db,
                study_id=trial.spec.study_id,
                candidate=candidate,
                environment=trial.spec.environment,
                reason=requests.QUERY,
                priority=QUERY_PRIORITY,
                trial_id=trial_id,
                now=now,
                seed=_run_seed(trial, query_index, candidate),
            )
    return found[sides[0].id], found[sides[1].id]


def _run_seed(trial: BoxTrial, query_index: int, candidate: Candidate) -> int:
    """The seed that a machine is given for a run, below 2^53."""
    sequence = np.random.SeedSequence(
        [trial.spec.seed, _RUN_DRAW, query_index, candidate.candidate_index]
    )
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))
