"""Records of deleted studies, so that their participants still get a return link.

No personal data is kept. The hash of a session's random token remains, by which the browser that
holds the token gets the platform's technical code; it is deleted after 30 days.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import delete, insert, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.ids import secret_hash
from app.storage.models.arrivals import DeletedSession, DeletedStudy, Reentry
from app.storage.models.studies import SessionRow, Study
from app.study import recruitment

from . import repository, session_modes

#: How long participants of a deleted study can get its code.
_CODE_KEPT = timedelta(days=30)

#: Outcomes that the platform knows, or that the participant chose: no code is due.
_SETTLED = ("declined", "withdrawn", "screened_out")


@dataclass(frozen=True)
class Deleted:
    """A deleted study.

    way_back: the return link, if the caller's token belonged to a session of it.
    """

    slug: str
    way_back: dict[str, Any] | None


def note(db: Session, study: Study, at: datetime) -> None:
    """Record the deletion of this study. Has to be called before its rows are deleted."""
    db.execute(delete(DeletedStudy).where(DeletedStudy.slug == study.slug))
    day = at.replace(hour=0, minute=0, second=0, microsecond=0)
    way_back = recruitment.described(
        repository.stored_plan(study.plans[-1]).recruitment, "technical"
    )
    deleted = DeletedStudy(slug=study.slug, way_back=way_back, deleted_on=day)
    db.add(deleted)
    db.flush()
    inside = (
        SessionRow.study_id == study.id,
        SessionRow.mode == session_modes.LIVE,
        SessionRow.stage.not_in(_SETTLED),
    )
    first = select(SessionRow.token_hash).where(*inside)
    again = select(Reentry.token_hash).join(SessionRow, Reentry.session_id == SessionRow.id)
    hashes = [*db.scalars(first), *db.scalars(again.where(*inside))]
    if hashes:
        db.execute(
            insert(DeletedSession),
            [{"deleted_study_id": deleted.id, "token_key": _key(hashed)} for hashed in hashes],
        )


def find(app: AppContext, slug: str | None, token: str | None) -> Deleted | None:
    """The deleted study with this slug, or with a session of this token; None if there is none.

    A slug that a new study has taken is not that of a deleted one.
    """
    with app.database.read() as db:
        if token is not None:
            statement = (
                select(DeletedStudy)
                .join(DeletedSession, DeletedSession.deleted_study_id == DeletedStudy.id)
                .where(DeletedSession.token_key == _key(secret_hash(token)))
            )
            deleted = db.scalar(statement)
            if deleted is not None and slug in (None, deleted.slug):
                return Deleted(deleted.slug, deleted.way_back)
        if slug is None or db.scalar(select(Study.id).where(Study.slug == slug)) is not None:
            return None
        deleted = db.scalar(select(DeletedStudy).where(DeletedStudy.slug == slug))
        return None if deleted is None else Deleted(deleted.slug, None)


def sweep(app: AppContext) -> int:
    """Delete the session hashes of studies deleted more than 30 days ago; return their number."""
    old = select(DeletedStudy.id).where(DeletedStudy.deleted_on <= app.now() - _CODE_KEPT)
    with app.database.write() as db:
        deleted = db.scalars(
            delete(DeletedSession)
            .where(DeletedSession.deleted_study_id.in_(old))
            .returning(DeletedSession.id)
        ).all()
    return len(deleted)


def _key(token_hash: str) -> str:
    """A hash other than the one in backups, so that the two cannot be joined without the token."""
    return hashlib.sha256(f"session of a deleted study:{token_hash}".encode()).hexdigest()
