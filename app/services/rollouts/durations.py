"""How long rollouts usually take, and how many machines are connected."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from statistics import median
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Machine, Rollout

from . import claims, states
from .machines import CONNECTED_FOR, DESK

#: Recorded rollouts that the usual duration is the median of.
LAST: Final = 10


@dataclass(frozen=True)
class Expectation:
    """What somebody who waits for a rollout is told.

    usually_s: seconds from claim to recording, the median of the last rollouts; None before the
    first. machines: how many are connected; the machine inside the server always is.
    """

    usually_s: float | None
    machines: int


def expectation(db: Session, study_id: int, environment: str, now: datetime) -> Expectation:
    """What to tell somebody who waits for a rollout in this environment."""
    is_inside = claims.plan_of(db, study_id).environments[environment].is_crane_machine
    machines = 1 if is_inside else connected(db, study_id, now)
    return Expectation(usually_s(db, study_id, environment), machines)


def usually_s(db: Session, study_id: int, environment: str) -> float | None:
    """Median seconds from claim to recording of the last rollouts; None if there are none."""
    rows = db.execute(
        select(Rollout.claimed_at, Rollout.ended_at)
        .where(
            Rollout.study_id == study_id,
            Rollout.environment == environment,
            Rollout.status == states.RECORDED,
            Rollout.claimed_at.is_not(None),
        )
        .order_by(Rollout.ended_at.desc(), Rollout.id.desc())
        .limit(LAST)
    )
    seconds = [
        (ended - claimed).total_seconds()
        for claimed, ended in rows
        if claimed is not None and ended is not None
    ]
    return median(seconds) if seconds else None


def connected(db: Session, study_id: int, now: datetime) -> int:
    """The number of machines with a token that have called lately."""
    since = now - CONNECTED_FOR
    return (
        db.scalar(
            select(func.count(Machine.id)).where(
                Machine.study_id == study_id,
                Machine.name != DESK,
                Machine.token_hash.is_not(None),
                Machine.revoked_at.is_(None),
                Machine.last_seen_at > since,
            )
        )
        or 0
    )
