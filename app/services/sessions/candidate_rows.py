"""Candidates of a search space given by ranges: a row for each point that was ever proposed.

All sessions of a study share them, so that a recorded point is recorded once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services.proposals.box_steps import Point, point_key
from app.storage.advisory_lock import advisory_xact_lock
from app.storage.models.studies import Candidate

from .box_trials import BoxTrial


def find(db: Session, trial: BoxTrial, points: Iterable[Point]) -> dict[Point, Candidate]:
    """The candidates at these points, as far as they have a row."""
    keys = {point: point_key(trial.space, point) for point in points}
    rows = _rows(db, trial, keys.values())
    return {point: rows[key] for point, key in keys.items() if key in rows}


def find_or_add(db: Session, trial: BoxTrial, points: Iterable[Point]) -> Mapping[Point, Candidate]:
    """The candidates at these points; those without a row are inserted in the order given.

    Transactions that insert candidates of the same environment exclude each other until they end,
    so that each point has one row and the indices have no gap.
    """
    keys = {point: point_key(trial.space, point) for point in points}
    rows = _rows(db, trial, keys.values())
    if not rows.keys() >= set(keys.values()):
        spec = trial.spec
        advisory_xact_lock(db, f"candidates of {spec.study_id} {spec.environment}")
        rows = _rows(db, trial, keys.values())
        last = db.scalar(
            select(func.max(Candidate.candidate_index)).where(
                Candidate.study_id == spec.study_id, Candidate.environment == spec.environment
            )
        )
        following = 0 if last is None else last + 1
        for point, key in keys.items():
            if key not in rows:
                rows[key] = Candidate(
                    study_id=spec.study_id,
                    environment=spec.environment,
                    candidate_index=following,
                    parameters=dict(zip(trial.space.names, point, strict=True)),
                    point_key=key,
                )
                db.add(rows[key])
                following += 1
        db.flush()
    return {point: rows[key] for point, key in keys.items()}


def _rows(db: Session, trial: BoxTrial, keys: Iterable[str]) -> dict[str, Candidate]:
    rows = db.scalars(
        select(Candidate).where(
            Candidate.study_id == trial.spec.study_id,
            Candidate.environment == trial.spec.environment,
            Candidate.point_key.in_(sorted(set(keys))),
        )
    )
    return {row.point_key or "": row for row in rows}
