"""The formats of a study's videos, which an evaluator's browser has to play."""

from __future__ import annotations

from sqlalchemy import exists, or_, select

from app.services.context import AppContext
from app.services.studies import repository
from app.storage.models.studies import Candidate, Recording

MP4, WEBM = "mp4", "webm"


def of(app: AppContext, slug: str) -> tuple[str, ...]:
    """Containers of the recordings that there are; MP4 where machines have made none yet.

    Videos of the crane are MP4. Raises NotFoundError.
    """
    study = repository.find(app, slug)
    mine = (
        exists()
        .where(Recording.candidate_id == Candidate.id, Candidate.study_id == study.id)
        .correlate(None)
    )
    is_webm = Recording.locator.like(f"%.{WEBM}")
    with app.database.read() as db:
        has_webm, has_mp4 = db.execute(
            select(
                mine.where(Recording.source == "file", is_webm),
                mine.where(or_(Recording.source == "crane", ~is_webm)),
            )
        ).one()
    return tuple(form for form, has in ((MP4, has_mp4 or not has_webm), (WEBM, has_webm)) if has)
