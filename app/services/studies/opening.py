"""What is asked before a stored draft is opened, since opening makes its plan final."""

from __future__ import annotations

from sqlalchemy import exists, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.storage.models.studies import Candidate, Recording, SessionRow
from app.study import doubts
from app.study.plan import Plan
from app.study.plan_source import STUDY_FILE
from app.study.recordings import RecordingRow
from app.study.validation_errors import Fault

from . import repository, session_modes
from .repository import StudyInfo


def doubts_before_opening(app: AppContext, study: StudyInfo) -> list[Fault]:
    """The doubts about a draft, among them that no preview was taken; none once it was open.

    Files that no part of the study names are known on the page of the files alone.
    """
    if study.status != repository.DRAFT:
        return []
    with app.database.read() as db:
        rows = _rows(db, study.id, study.plan)
        looked = db.scalar(
            select(
                exists().where(
                    SessionRow.study_id == study.id,
                    SessionRow.mode.in_([session_modes.PREVIEW, session_modes.PILOT]),
                )
            )
        )
    found = doubts.doubts(study.plan, study.texts, rows, (), repository.random_queries)
    if not looked:
        found.append(Fault(STUDY_FILE, None, "its pages have not been previewed as an evaluator"))
    return found


def _rows(db: Session, study_id: int, plan: Plan) -> list[RecordingRow]:
    """The rows of the study's own tables, in their order."""
    names = [parameter.name for parameter in plan.parameters]
    stored = db.execute(
        select(Candidate, Recording)
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(Candidate.study_id == study_id, Recording.file.is_not(None))
        .order_by(Candidate.id, Recording.run_index)
    )
    return [
        RecordingRow(
            candidate.environment,
            tuple(candidate.parameters[name] for name in names),
            recording.file or "",
            recording.locator,
            recording.duration_s,
            recording.score,
        )
        for candidate, recording in stored
    ]
