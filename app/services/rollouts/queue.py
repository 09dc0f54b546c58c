"""The list of a study's rollouts: queue and past, for pages and the API."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import joinedload

from app.services.context import AppContext
from app.storage.models.rollouts import Rollout


@dataclass(frozen=True)
class RolloutLine:
    """A rollout of the list. number: increases with the time at which it was asked."""

    number: int
    public_id: str
    environment: str
    candidate_index: int
    parameters: Mapping[str, Any]
    run_index: int
    reason: str
    priority: int
    status: str
    attempt: int
    machine: str | None
    progress: float | None
    asked_at: datetime
    claimed_at: datetime | None
    lease_until: datetime | None
    ended_at: datetime | None
    explanation: str | None
    failures: list[dict[str, Any]]
    sha256: str | None
    score: float | None


def rollouts(
    app: AppContext,
    study_id: int,
    *,
    statuses: Collection[str] = (),
    before: int | None = None,
    limit: int = 100,
) -> list[RolloutLine]:
    """Rollouts of a study, the newest first.

    statuses: only those in these states; empty for all. before: only those with a smaller number.
    """
    statement = (
        select(Rollout)
        .where(Rollout.study_id == study_id)
        .options(joinedload(Rollout.candidate), joinedload(Rollout.machine))
        .order_by(Rollout.id.desc())
        .limit(limit)
    )
    if statuses:
        statement = statement.where(Rollout.status.in_(statuses))
    if before is not None:
        statement = statement.where(Rollout.id < before)
    with app.database.read() as db:
        return [line(row) for row in db.scalars(statement)]


def counts(app: AppContext, study_id: int) -> Mapping[str, int]:
    """The numbers of a study's rollouts, by state."""
    with app.database.read() as db:
        rows = db.execute(
            select(Rollout.status, func.count(Rollout.id))
            .where(Rollout.study_id == study_id)
            .group_by(Rollout.status)
        )
        return {status: number for status, number in rows}  # noqa: C416 - rows are no pairs


def line(row: Rollout) -> RolloutLine:
    """The line of a rollout, whose candidate and machine are read if they are not loaded."""
    return RolloutLine(
        number=row.id,
        public_id=row.public_id,
        environment=row.environment,
        candidate_index=row.candidate.candidate_index,
        parameters=dict(row.candidate.parameters),
        run_index=row.run_index,
        reason=row.reason,
        priority=row.priority,
        status=row.status,
        attempt=row.attempt,
        machine=None if row.machine is None else row.machine.name,
        progress=row.progress,
        asked_at=row.asked_at,
        claimed_at=row.claimed_at,
        lease_until=row.lease_until,
        ended_at=row.ended_at,
        explanation=row.explanation,
        failures=list(row.failures),
        sha256=row.sha256,
        score=row.score,
    )
