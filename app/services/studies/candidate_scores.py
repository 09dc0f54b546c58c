"""Scores of candidates, from the score column of the experimenter's recordings table."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.storage.models.studies import Candidate, Recording


def mean_scores(db: Session, study_id: int) -> dict[tuple[str, int], float]:
    """The mean score of each candidate's scored recordings, by environment and candidate index."""
    rows = db.execute(
        select(Candidate.environment, Candidate.candidate_index, func.avg(Recording.score))
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(Candidate.study_id == study_id, Recording.score.is_not(None))
        .group_by(Candidate.environment, Candidate.candidate_index)
        .order_by(Candidate.environment, Candidate.candidate_index)
    )
    return {(environment, index): float(score) for environment, index, score in rows}
