"""Results of one trial by name, and the path of its acquired candidate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.monitoring.session_detail import find_session
from app.services.runtime.errors import NotFoundError
from app.services.sessions import queries
from app.services.studies.repository import StudyInfo, stored_plan
from app.storage.models.studies import Acquired, Trial

from .result import Result, Row
from .trial_posterior import is_sure, posterior


def find(app: AppContext, study: StudyInfo, session_id: str, trial_index: int, name: str) -> Result:
    """Compute one result of a trial. name: a key of LEARNING. Raises NotFoundError."""
    with app.database.read() as db:
        row = find_session(db, study, session_id)
        trial = db.scalar(
            select(Trial).where(Trial.session_id == row.id, Trial.trial_index == trial_index)
        )
        if trial is None or trial_index < 0:
            raise NotFoundError(f"the session {session_id!r} has no trial {trial_index}")
        return LEARNING[name](app, db, trial)


def path(app: AppContext, db: Session, trial: Trial) -> Result:
    """The acquired candidate after each answer."""
    space = app.proposer.candidate_set(trial.session.study_id, trial.environment)
    rows: list[Row] = [
        {
            "query_index": at,
            "candidate": candidate,
            **_point(space, candidate),
            "posterior_mean": mean,
            "posterior_std": std,
            "sureness": sureness,
        }
        for at, candidate, mean, std, sureness in db.execute(
            select(
                Acquired.query_index,
                Acquired.candidate,
                Acquired.posterior_mean,
                Acquired.posterior_std,
                Acquired.sureness,
            )
            .where(Acquired.trial_id == trial.id)
            .order_by(Acquired.query_index)
        )
    ]
    if not rows:
        return Result((), "Nothing is acquired before the first answer.")
    moves = [
        number
        for number, (before, here) in enumerate(pairwise(rows), start=2)
        if before["candidate"] != here["candidate"]
    ]
    last = f"the last time at answer {moves[-1]}" if moves else "from the first answer on"
    says = (
        f"Candidate {rows[-1]['candidate']} is acquired after {len(rows)} answers;"
        f" it changed {len(moves)} times, {last}."
        if moves
        else f"Candidate {rows[-1]['candidate']} is acquired {last}."
    )
    says += is_sure(rows[-1]["sureness"], stored_plan(trial.session.plan).within)
    shown = len(queries.read_record(db, trial.id))
    if shown > len(rows):
        says += (
            f" Counted are answers that the model learns from: {shown - len(rows)} checks are not."
        )
    return Result(rows, says)


def _point(space: Any, candidate: int) -> dict[str, float]:
    return dict(zip(space.parameters, map(float, space.candidates[candidate]), strict=True))


LEARNING: Final[Mapping[str, Callable[[AppContext, Session, Trial], Result]]] = MappingProxyType(
    {"path": path, "posterior": posterior}
)
