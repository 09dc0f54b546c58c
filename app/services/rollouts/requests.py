"""Requests for rollouts: ask for a run of a candidate, and take back what nobody waits for.

A candidate has at most one outstanding rollout, so sessions that need the same candidate at the
same time wait for the same run.
"""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from typing import Final

from sqlalchemy import ColumnElement, exists, func, or_, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session, aliased

from app.services.runtime.ids import new_public_id
from app.storage.models.rollouts import OUTSTANDING, Rollout
from app.storage.models.studies import Candidate, QueryRow, Recording

from . import states, work_signal

#: Why a rollout is asked: a query waits for it, it may be needed next, or it shows the acquired
#: candidate at the end.
QUERY: Final = "query"
AHEAD: Final = "ahead"
ACQUIRED: Final = "acquired"
#: The stronger of two reasons is kept when an outstanding rollout is asked for again.
_STRENGTH: Final = {QUERY: 2, ACQUIRED: 1, AHEAD: 0}
#: How often an insert is tried again after another transaction inserted first.
_TRIES: Final = 5


def ask(
    db: Session,
    *,
    study_id: int,
    candidate: Candidate,
    environment: str,
    reason: str,
    priority: int,
    trial_id: int | None,
    now: datetime,
    seed: int,
) -> Rollout:
    """Return the candidate's outstanding rollout, or create one with status `asked`.

    An outstanding one keeps its seed and its trial; it takes the smaller priority and the stronger
    reason. Machines of this process that wait for work are woken after the commit.

    reason: QUERY, AHEAD or ACQUIRED. priority: the smallest number is claimed first. trial_id: the
    trial that asks. seed: what the machine is given as the seed of the run, below 2^53.
    """
    for _ in range(_TRIES):
        found = outstanding(db, candidate.id)
        if found is not None:
            _strengthen(found, reason, priority)
            return found
        made = Rollout(
            public_id=new_public_id(),
            study_id=study_id,
            environment=environment,
            candidate_id=candidate.id,
            run_index=_next_run_index(db, candidate.id),
            seed=seed,
            reason=reason,
            priority=priority,
            trial_id=trial_id,
            status=states.ASKED,
            attempt=0,
            asked_at=now,
            failures=[],
        )
        try:
            with db.begin_nested():
                db.add(made)
        except IntegrityError:
            # Another session has asked for a run of the same candidate meanwhile.
            continue
        work_signal.notify_after_commit(db)
        return made
    raise RuntimeError(f"the candidate {candidate.id} could not be asked for: too many at once")


def take_back(
    db: Session, trial_id: int, keep: Collection[int], now: datetime, *, is_over: bool = False
) -> int:
    """Cancel the unclaimed rollouts that this trial asked for, and return their number.

    Kept are those of the candidates in `keep` (ids of rows), and those that an open query of any
    trial waits for, and those of acquired candidates. is_over: whether the trial's session has
    ended, so that its own open query waits for nothing.
    """
    waiting = aliased(QueryRow)
    awaited: ColumnElement[bool] = exists().where(
        waiting.set_aside_at.is_(None),
        *((waiting.trial_id != trial_id,) if is_over else ()),
        or_(
            (waiting.left_rollout_id == Rollout.id) & waiting.left_recording_id.is_(None),
            (waiting.right_rollout_id == Rollout.id) & waiting.right_recording_id.is_(None),
        ),
    )
    taken = db.scalars(
        select(Rollout)
        .where(
            Rollout.trial_id == trial_id,
            Rollout.status == states.ASKED,
            Rollout.reason != ACQUIRED,
            Rollout.candidate_id.not_in(list(keep)),
            ~awaited,
        )
        .order_by(Rollout.id)
        .with_for_update(skip_locked=True)
    ).all()
    for rollout in taken:
        rollout.status = states.CANCELLED
        rollout.ended_at = now
        rollout.explanation = "not needed any more"
    return len(taken)


def outstanding(db: Session, candidate_id: int) -> Rollout | None:
    """The rollout of a candidate that is asked or claimed, locked for this transaction; or None."""
    return db.scalar(
        select(Rollout)
        .where(Rollout.candidate_id == candidate_id, Rollout.status.in_(OUTSTANDING))
        .with_for_update()
        .execution_options(populate_existing=True)
    )


def _strengthen(rollout: Rollout, reason: str, priority: int) -> None:
    if _STRENGTH[reason] > _STRENGTH[rollout.reason]:
        rollout.reason = reason
    rollout.priority = min(priority, rollout.priority)


def _next_run_index(db: Session, candidate_id: int) -> int:
    used = [
        db.scalar(select(func.max(table.run_index)).where(table.candidate_id == candidate_id))
        for table in (Rollout, Recording)
    ]
    return max((index for index in used if index is not None), default=-1) + 1
