"""What sessions read of rollouts: recordings that exist, and candidates that must not be run."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate

from . import states


def newest_recorded(db: Session, candidate_ids: Collection[int]) -> Mapping[int, Rollout]:
    """The newest recorded rollout of each of these candidates (ids of rows) that has one.

    Withdrawn recordings do not count.
    """
    rows = db.scalars(
        select(Rollout)
        .where(Rollout.candidate_id.in_(candidate_ids), Rollout.status == states.RECORDED)
        .order_by(Rollout.run_index)
    )
    return {rollout.candidate_id: rollout for rollout in rows}


def unsafe_candidates(db: Session, study_id: int, environment: str) -> frozenset[int]:
    """Indices of the candidates of an environment that a machine has reported to be unsafe."""
    return frozenset(
        db.scalars(
            select(Candidate.candidate_index)
            .join(Rollout, Rollout.candidate_id == Candidate.id)
            .where(
                Rollout.study_id == study_id,
                Rollout.environment == environment,
                Rollout.status == states.UNSAFE,
            )
        )
    )
