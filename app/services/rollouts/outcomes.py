"""Outcomes of rollouts: recorded, failed, unsafe, cancelled, withdrawn; and retries.

The functions run within the caller's transaction, on a rollout that the caller has locked. Sessions
are not notified: each looks at the rollouts that its open query waits for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from sqlalchemy import or_, select, update
from sqlalchemy.orm import Session

from app.services.recordings import recordings
from app.services.runtime.errors import ConflictError, NotFoundError
from app.services.runtime.ids import new_public_id
from app.storage.models.rollouts import OUTSTANDING, Machine, Rollout
from app.storage.models.studies import QueryRow, Recording, Response

from . import requests, states, work_signal

#: Reasons recorded for an attempt that ended without a word from its machine.
LEASE_ENDED: Final = "nothing was heard of the machine in time"


@dataclass(frozen=True)
class Made:
    """A video in the store of own videos, and the machine's own numbers on the run.

    locator: its name in the store. sha256: of the bytes that the machine sent. score: finite.
    series: a JSON object.
    """

    locator: str
    sha256: str
    duration_s: float
    score: float | None = None
    series: Mapping[str, Any] | None = None


def locked(db: Session, study_id: int, public_id: str) -> Rollout:
    """The rollout with this id, locked until the transaction ends. Raises NotFoundError."""
    rollout = db.scalar(
        select(Rollout)
        .where(Rollout.study_id == study_id, Rollout.public_id == public_id)
        .with_for_update()
        .execution_options(populate_existing=True)
    )
    if rollout is None:
        raise NotFoundError("there is no such rollout in this study")
    return rollout


def record(
    db: Session, rollout: Rollout, made: Made, machine_id: int | None, now: datetime
) -> Recording:
    """Store the recording of a rollout, whose run index it gets, and end the rollout.

    machine_id: the machine whose bytes these are; it need not hold the lease any more.
    """
    recording = Recording(
        candidate_id=rollout.candidate_id,
        run_index=rollout.run_index,
        public_id=new_public_id(),
        source=recordings.FILE,
        locator=made.locator,
        file=None,
        duration_s=made.duration_s,
        score=made.score,
    )
    db.add(recording)
    db.flush()
    _end(rollout, states.RECORDED, now, None)
    rollout.machine_id = machine_id
    rollout.recording_id = recording.id
    rollout.sha256 = made.sha256
    rollout.score = made.score
    rollout.series = None if made.series is None else dict(made.series)
    rollout.progress = None
    return recording


def fail(
    db: Session,
    rollout: Rollout,
    *,
    machine: Machine | None,
    reason: str,
    attempts: int,
    now: datetime,
) -> None:
    """End an attempt that failed: ask again while attempts remain, else end the rollout as failed.

    machine: which one failed. attempts: how many failed attempts end a rollout; failures before a
    retry do not count.
    """
    entry = {
        "attempt": rollout.attempt,
        "machine": None if machine is None else machine.name,
        "at": now.isoformat(),
        "reason": reason,
    }
    rollout.failures = [*rollout.failures, entry]
    if failures_in_a_row(rollout) >= attempts:
        _end(rollout, states.FAILED, now, reason)
    else:
        ask_again(db, rollout)


def ask_again(db: Session, rollout: Rollout) -> None:
    """Release the claim, so that any machine may claim the rollout; counts as no failure."""
    rollout.status = states.ASKED
    rollout.machine_id = None
    rollout.lease_until = rollout.claimed_at = rollout.ended_at = None
    rollout.progress = None
    rollout.explanation = None
    work_signal.notify_after_commit(db)


def failures_in_a_row(rollout: Rollout) -> int:
    """The number of failed attempts since the rollout was asked or last retried."""
    number = 0
    for entry in reversed(rollout.failures):
        if "retried_at" in entry:
            break
        number += 1
    return number


def mark_unsafe(rollout: Rollout, machine_id: int | None, reason: str, now: datetime) -> None:
    """End the rollout as unsafe: its candidate is never proposed again. It cannot be retried."""
    _end(rollout, states.UNSAFE, now, reason)
    rollout.machine_id = machine_id


def cancel(rollout: Rollout, explanation: str, now: datetime) -> None:
    """End an outstanding rollout. Raises ConflictError if it has ended."""
    if rollout.status not in OUTSTANDING:
        raise ConflictError(
            f"expected a rollout that has not ended, got one that is {rollout.status}"
        )
    _end(rollout, states.CANCELLED, now, explanation)


def retry(db: Session, rollout: Rollout, actor: str, now: datetime) -> None:
    """Ask again for a rollout that failed or was cancelled, with all its attempts.

    Raises ConflictError for another state, or if the candidate has another outstanding rollout.
    """
    if rollout.status not in (states.FAILED, states.CANCELLED):
        raise ConflictError(
            f"expected a rollout that failed or was cancelled, got one that is {rollout.status}"
        )
    if requests.outstanding(db, rollout.candidate_id) is not None:
        raise ConflictError("expected no other rollout of these parameters, and one is under way")
    rollout.failures = [*rollout.failures, {"retried_at": now.isoformat(), "by": actor}]
    ask_again(db, rollout)


def withdraw(db: Session, rollouts: Collection[Rollout], explanation: str, now: datetime) -> int:
    """Withdraw recorded rollouts; the responses to queries that showed them leave the model.

    Recordings, queries and responses are kept; what was derived from them is left to the caller.
    Returns the number of responses. Raises ConflictError if a rollout was not recorded.
    """
    for rollout in rollouts:
        if rollout.status != states.RECORDED:
            raise ConflictError(f"expected a recorded rollout, got one that is {rollout.status}")
        rollout.status = states.WITHDRAWN
        rollout.explanation = explanation
    ids = [rollout.id for rollout in rollouts]
    judged = db.scalars(
        select(QueryRow.id)
        .join(Response, Response.query_id == QueryRow.id)
        .where(
            or_(QueryRow.left_rollout_id.in_(ids), QueryRow.right_rollout_id.in_(ids)),
            QueryRow.withdrawn_at.is_(None),
        )
    ).all()
    db.execute(update(QueryRow).where(QueryRow.id.in_(judged)).values(withdrawn_at=now))
    return len(judged)


def recorded_by(db: Session, machine_id: int, since: datetime) -> list[int]:
    """The ids of the recorded rollouts of a machine that ended at this time or later."""
    return list(
        db.scalars(
            select(Rollout.id)
            .where(
                Rollout.machine_id == machine_id,
                Rollout.status == states.RECORDED,
                Rollout.ended_at >= since,
            )
            .order_by(Rollout.id)
        )
    )


def _end(rollout: Rollout, status: str, now: datetime, explanation: str | None) -> None:
    rollout.status = status
    rollout.ended_at = now
    rollout.lease_until = None
    rollout.explanation = explanation
