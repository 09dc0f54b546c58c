"""The data of a study's overview page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from app.services.arrival import decline_counter
from app.services.context import AppContext
from app.services.sessions.state_view import ENDED
from app.services.studies.repository import StudyInfo
from app.services.studies.session_modes import ALL
from app.study.reward import Reward

from . import session_list
from .change_token import change_token
from .conditions import ConditionLine, conditions
from .funnel import Step, funnel
from .incidents import Incident, incidents
from .session_list import SessionLine


@dataclass(frozen=True)
class Pay:
    """The reward of one session, and the rate per hour at the median duration.

    The rate is None until a session is completed.
    """

    amount: float
    currency: str
    per_hour: float | None


@dataclass(frozen=True)
class Overview:
    """The present state of a study. minutes: median duration of the completed sessions."""

    stamp: str
    counts: Mapping[str, int]
    steps: tuple[Step, ...]
    conditions: Sequence[ConditionLine]
    sessions: Sequence[SessionLine]
    minutes: float | None
    pay: Pay | None
    troubles: Sequence[Incident]


def modes_of(mode: str) -> tuple[str, ...]:
    """The modes that a filter value of the page selects: one, or all for "all"."""
    return ALL if mode == "all" else (mode,)


def overview(app: AppContext, study: StudyInfo, mode: str) -> Overview:
    """Read the overview of a study. mode: live, preview, pilot, simulated, or all."""
    modes = modes_of(mode)
    # The token first: a change during the other reads then causes another update.
    now = change_token(app, study.id, modes, study.plan.lease_minutes)
    lines = session_list.sessions(app, study, modes)
    stages = [line.stage for line in lines]
    ended = {stage: stages.count(stage) for stage in ENDED}
    minutes = median_minutes(lines)
    reward = study.plan.reward
    deleted = session_list.deleted(app, study.id, modes)
    declined = decline_counter.total(app, study.id, modes)
    return Overview(
        stamp=now,
        counts={
            "active": len(lines) - sum(ended.values()),
            **ended,
            "declined": ended["declined"] + declined,
            "deleted": deleted,
        },
        steps=funnel(lines, deleted + declined),
        conditions=conditions(app, study, modes),
        sessions=lines,
        minutes=minutes,
        pay=None if reward is None else _pay(reward, minutes),
        troubles=incidents(app, study),
    )


def _pay(reward: Reward, minutes: float | None) -> Pay:
    return Pay(reward.amount, reward.currency, reward.per_hour(minutes) if minutes else None)


def median_minutes(lines: Sequence[SessionLine]) -> float | None:
    """Median minutes from start to end of completed sessions, breaks included; None without any."""
    minutes = [
        (line.ended_at - line.started_at).total_seconds() / 60
        for line in lines
        if line.presence == "completed" and line.ended_at is not None
    ]
    return median(minutes) if minutes else None
