"""Numbers of active and of completed trials by condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta

from sqlalchemy import and_, case, func, select

from app.services.context import AppContext
from app.services.sessions.state_view import ENDED
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import SessionRow, Trial


@dataclass(frozen=True)
class ConditionLine:
    """One condition.

    active: unfinished trials of sessions that were last seen within the study's lease. completed:
    finished trials, also of unfinished sessions. off: not assigned to new sessions.
    """

    name: str
    method: str
    environment: str
    active: int
    completed: int
    off: bool


def conditions(app: AppContext, study: StudyInfo, modes: Sequence[str]) -> list[ConditionLine]:
    """The conditions in the order of the plan, then those of earlier plans only."""
    since = app.now() - timedelta(minutes=study.plan.lease_minutes)
    under_way = and_(
        Trial.ended_at.is_(None), SessionRow.stage.not_in(ENDED), SessionRow.last_seen_at >= since
    )
    with app.database.read() as db:
        found = {
            name: (method, environment, int(active), int(completed))
            for name, method, environment, active, completed in db.execute(
                select(
                    Trial.condition,
                    func.max(Trial.method),
                    func.max(Trial.environment),
                    func.sum(case((under_way, 1), else_=0)),
                    func.count(Trial.ended_at),
                )
                .join(SessionRow, Trial.session_id == SessionRow.id)
                .where(
                    SessionRow.study_id == study.id,
                    SessionRow.mode.in_(modes),
                    Trial.trial_index >= 0,
                )
                .group_by(Trial.condition)
            )
        }
    lines = []
    for condition in study.plan.conditions:
        *_, active, completed = found.pop(condition.name, ("", "", 0, 0))
        off = condition.name in study.conditions_off
        lines.append(
            ConditionLine(
                condition.name, condition.method, condition.environment, active, completed, off
            )
        )
    lines += [ConditionLine(name, *rest, off=True) for name, rest in sorted(found.items())]
    return lines
