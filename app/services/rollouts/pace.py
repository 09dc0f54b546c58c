"""Whether machines keep up with the people who judge what they record."""

from __future__ import annotations

from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Recording
from app.study.plan import Plan

from . import durations, states


def slower_than_viewing(db: Session, study_id: int, plan: Plan, machines: int) -> list[str]:
    """A sentence for each environment whose next pair takes longer to record than one to watch.

    Compares medians of the last rollouts. machines: how many are connected; they share the rollouts
    of a pair. Empty before the first recording.
    """
    found = []
    for name, environment in plan.environments.items():
        taken = durations.usually_s(db, study_id, name) if environment.is_machine else None
        watched = _viewing_s(db, study_id, name)
        if taken is None or watched is None:
            continue
        rollout = environment.rollout
        at_once = 1 if environment.is_crane_machine else max(machines, 1)
        needed = taken * -(-rollout.new_per_query // at_once)
        if needed <= watched * (1 + rollout.lag):
            continue
        settings = [word for word in ("lag", "ahead") if getattr(rollout, word) == 0]
        remedy = f"set {' or '.join(settings)}" if settings else "shorten the runs, or add machines"
        each = "" if len(plan.environments) == 1 else f"{name}: "
        found.append(
            f"{each}a pair takes {watched:.0f} s to watch, and the last rollouts took {taken:.0f} s"
            f" each: people wait for every pair; {remedy}"
        )
    return found


def _viewing_s(db: Session, study_id: int, environment: str) -> float | None:
    """Median duration in seconds of the last recordings of an environment; None without one."""
    lasting = db.scalars(
        select(Recording.duration_s)
        .join(Rollout, Rollout.recording_id == Recording.id)
        .where(
            Rollout.study_id == study_id,
            Rollout.environment == environment,
            Rollout.status == states.RECORDED,
        )
        .order_by(Rollout.ended_at.desc(), Rollout.id.desc())
        .limit(durations.LAST)
    )
    known = [seconds for seconds in lasting if seconds]
    return median(known) if known else None
