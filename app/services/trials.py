"""How a trial begins: what a stage on the way to it prepares, its seed, and its first query."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from app.storage.tables import QueryRow, SessionRow, Trial
from app.study.protocol import Stage
from app.study.stages import PRACTICE, PRACTICE_INDEX

from . import playlist, practice, queries, studies
from .proposals import NextQuery
from .studio import Studio
from .tokens import new_public_id


def arrive(studio: Studio, session: Session, row: SessionRow) -> None:
    """Prepare what the stage that the session has come to will show."""
    if row.stage == Stage.QUERY:
        _begin(studio, session, row)
    elif row.stage == Stage.PRACTICE:
        _begin_practice(studio, session, row)
    elif row.stage in (Stage.BREAK, Stage.FAMILIARISATION):
        # Whoever goes on from here finds the first pair made.
        first = first_query(studio, row)
        coming = [first.left, first.right]
        plan = studies.plan_of(row)
        if plan.familiarises_before(row.trial_index):
            coming = [*playlist.clips(studio, row), *coming]
        studio.proposer.render(coming)


def _begin(studio: Studio, session: Session, row: SessionRow) -> None:
    """Store the trial that the session has come to, with its first query."""
    first = first_query(studio, row)
    condition = studies.stored_plan(row.plan).conditions[row.trial_conditions[row.trial_index]]
    now = studio.now()
    trial = Trial(
        session_id=row.id,
        trial_index=row.trial_index,
        condition=condition.name,
        method=condition.method,
        environment=condition.environment,
        seed=queries.trial_seed(row, row.trial_index),
        started_at=now,
        queries=[query_row(first, now)],
    )
    session.add(trial)
    session.flush()
    studio.proposer.render([first.left, first.right])


def _begin_practice(studio: Studio, session: Session, row: SessionRow) -> None:
    """Store the practice, with its first query."""
    now = studio.now()
    trial = Trial(
        session_id=row.id,
        trial_index=PRACTICE_INDEX,
        condition=PRACTICE,
        method="random",
        environment=queries.trial_in_hand(row, PRACTICE_INDEX, 0).environment,
        seed=queries.trial_seed(row, PRACTICE_INDEX),
        started_at=now,
    )
    first = practice_query(studio, row, 0)
    trial.queries.append(query_row(first, now))
    session.add(trial)
    session.flush()
    after = first_query(studio, row)
    studio.proposer.render([first.left, first.right, after.left, after.right])


def practice_query(studio: Studio, row: SessionRow, query_index: int) -> NextQuery:
    """The practice's query at this place."""
    in_hand = queries.trial_in_hand(row, PRACTICE_INDEX, queries.trial_seed(row, PRACTICE_INDEX))
    space = studio.proposer.space(in_hand.study_id, in_hand.environment)
    return practice.pair(space, in_hand.seed, query_index)


def first_query(studio: Studio, row: SessionRow) -> NextQuery:
    """The first query of that trial: drawn at random, with no model to fit."""
    in_hand = queries.trial_in_hand(row, row.trial_index, queries.trial_seed(row, row.trial_index))
    first = studio.proposer.step(in_hand, ()).next
    assert first is not None
    return first


def query_row(
    following: NextQuery, now: datetime, trial_id: int | None = None, attempt: int = 0
) -> QueryRow:
    return QueryRow(**query_columns(following, now, trial_id, attempt))


def query_columns(
    following: NextQuery, now: datetime, trial_id: int | None = None, attempt: int = 0
) -> dict[str, Any]:
    """A query, to be stored before it is shown."""
    return {
        "trial_id": trial_id,
        "public_id": new_public_id(),
        "query_index": following.query_index,
        "attempt": attempt,
        "trial_type": following.trial_type,
        "left_candidate": following.left_candidate,
        "right_candidate": following.right_candidate,
        "left_recording_id": following.left.id,
        "right_recording_id": following.right.id,
        "acquisition": following.acquisition,
        "seed": following.seed,
        "engine_version": following.engine_version,
        "repeats_query_index": following.repeats,
        "created_at": now,
        "shown_at": now,
    }
