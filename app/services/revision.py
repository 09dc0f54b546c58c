"""New texts for a study under way: a further version of its plan.

A plan is frozen once a study opens, and so are its recordings. Its texts may have to change all the
same: an ethics board asks for another sentence. What is compared stays as it was. Where the
consent has changed, `consents` asks everybody inside for theirs again.
"""

from __future__ import annotations

from pathlib import PurePosixPath

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.tables import Candidate, PlanVersion, Recording, Study
from app.study.folder import StudyFolder
from app.study.plan import plan_hash

from . import recordings, studies
from .errors import ConflictError
from .studies import StudyInfo
from .studio import Studio


def revise(studio: Studio, folder: StudyFolder) -> StudyInfo:
    """Give a study the texts of this folder. The same texts again change nothing.

    Raises NotFoundError, or ConflictError if anything but the texts has changed.
    """
    slug = folder.plan.slug
    with studio.database.write() as session:
        before = studies.read(session, slug)
        _require_the_same(session, before, folder)
        texts = {language: dict(named) for language, named in folder.texts.items()}
        if texts == before.texts:
            return before
        study = session.scalars(select(Study).where(Study.slug == slug)).one()
        study.plans.append(
            PlanVersion(
                version=before.plan_version + 1,
                plan_hash=plan_hash(folder.plan, folder.texts, folder.recordings),
                plan=folder.plan.model_dump(mode="json"),
                texts=texts,
                created_at=studio.now(),
            )
        )
        session.flush()
        return studies.read(session, slug)


def _require_the_same(session: Session, before: StudyInfo, folder: StudyFolder) -> None:
    if before.plan != folder.plan:
        raise ConflictError(
            f"expected the plan that {before.slug!r} has: once a study is created, only its texts"
            " may change"
        )
    stored = session.execute(
        select(Candidate.environment, Recording.locator)
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(Candidate.study_id == before.id, Recording.source == recordings.FILE)
    )
    given = {
        (row.environment, f"{row.sha256}{PurePosixPath(row.file).suffix.lower()}")
        for row in folder.recordings
    }
    if {tuple(row) for row in stored} != given:
        raise ConflictError(
            f"expected the recordings that {before.slug!r} has: once a study is created, only its"
            " texts may change"
        )
