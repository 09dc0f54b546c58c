"""Whether machines keep up with the people who judge what they record."""

from __future__ import annotations

from math import ceil
from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Recording

from . import durations, states


def slower_than_viewing(app: AppContext, study: StudyInfo) -> list[str]:
    """A sentence for each environment whose next pair takes longer to record than one to watch.

    Compares medians of the last rollouts. Connected machines share the rollouts of a pair. Empty
    before the first recording.
    """
    with app.database.read() as db:
        machines = max(durations.connected(db, study.id, app.now()), 1)
        found = [
            _sentence(db, study, name, 1 if environment.is_crane_machine else machines)
            for name, environment in study.plan.environments.items()
            if environment.is_machine
        ]
    return [sentence for sentence in found if sentence is not None]


def _sentence(db: Session, study: StudyInfo, name: str, machines: int) -> str | None:
    taken, watched = durations.usually_s(db, study.id, name), _viewing_s(db, study.id, name)
    if taken is None or watched is None:
        return None
    rollout = study.plan.environments[name].rollout
    if taken * ceil(rollout.new_per_query / machines) <= watched * (1 + rollout.lag):
        return None
    settings = [word for word in ("lag", "ahead") if getattr(rollout, word) == 0]
    remedy = f"set {' or '.join(settings)}" if settings else "shorten the runs, or add machines"
    place = "" if len(study.plan.environments) == 1 else f"{name}: "
    return (
        f"{place}a pair takes {watched:.0f} s to watch, and the last rollouts took {taken:.0f} s"
        f" each: people wait for every pair; {remedy}"
    )


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
