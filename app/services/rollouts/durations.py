"""How long rollouts take, how many machines are connected, and which studies lack one."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from statistics import median
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Study

from . import claims, states
from .machines import CONNECTED_FOR, DESK

#: Recorded rollouts that the usual duration is the median of.
LAST: Final = 10


#: A rollout that waits for less time is no sign that a machine is away.
MISSED_AFTER: Final = timedelta(seconds=30)


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


@dataclass(frozen=True)
class Unattended:
    """A study whose rollouts wait while none of its machines is connected.

    waiting: number of rollouts. since: when the oldest was asked. is_stopped: whether that is so
    because of the emergency stop.
    """

    study_id: int
    waiting: int
    since: datetime
    is_stopped: bool


def unattended(db: Session, now: datetime, study_id: int | None = None) -> list[Unattended]:
    """The studies whose rollouts wait and that have no machine, or whose machines are stopped.

    study_id: only this study. Rollouts of the machine inside the server count only while machines
    are stopped.
    """
    statement = (
        select(
            Rollout.study_id,
            Rollout.environment,
            Study.machines_stopped_at,
            func.count(Rollout.id),
            func.min(Rollout.asked_at),
        )
        .join(Study, Rollout.study_id == Study.id)
        .where(Rollout.status == states.ASKED, Rollout.asked_at <= now - MISSED_AFTER)
        .group_by(Rollout.study_id, Rollout.environment, Study.machines_stopped_at)
    )
    if study_id is not None:
        statement = statement.where(Rollout.study_id == study_id)
    found: dict[int, Unattended] = {}
    for study, environment, stopped_at, number, since in db.execute(statement).all():
        is_stopped = stopped_at is not None
        is_inside = claims.plan_of(db, study).environments[environment].is_crane_machine
        if not is_stopped and (is_inside or connected(db, study, now)):
            continue
        before = found.get(study)
        found[study] = Unattended(
            study,
            number + (before.waiting if before else 0),
            min(since, before.since) if before else since,
            is_stopped,
        )
    return list(found.values())
