"""What is left of a deleted study: that it is gone, and the way back for those who were in it.

Nothing of a person is kept. A session's random token leaves a hash, by which the browser that has
the token can be given the platform's technical code; after 30 days that goes, too.
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

#: For how long those who were in a study can be given its code.
_CODE_KEPT = timedelta(days=30)

#: Ways of ending that a platform has been told of, or that were the person's own.
_SETTLED = ("declined", "withdrawn", "screened_out")


@dataclass(frozen=True)
class Deleted:
    """A study that is gone. way_back: for whoever asks, if they were in it."""

    slug: str
    way_back: dict[str, Any] | None


def note(db: Session, study: Study, at: datetime) -> None:
    """Keep that this study is deleted. Call it before its rows are."""
    db.execute(delete(DeletedStudy).where(DeletedStudy.slug == study.slug))
    day = at.replace(hour=0, minute=0, second=0, microsecond=0)
    way_back = recruitment.described(
        repository.stored_plan(study.plans[-1]).recruitment, "technical"
    )
    gone = DeletedStudy(slug=study.slug, way_back=way_back, deleted_on=day)
    db.add(gone)
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
            [{"deleted_study_id": gone.id, "token_key": _key(hashed)} for hashed in hashes],
        )


def find(app: AppContext, slug: str | None, token: str | None) -> Deleted | None:
    """The deleted study of this address, or that the token was of; None if there is none such.

    A study of the same address that is there by now is not deleted.
    """
    with app.database.read() as db:
        if token is not None:
            statement = (
                select(DeletedStudy)
                .join(DeletedSession, DeletedSession.deleted_study_id == DeletedStudy.id)
                .where(DeletedSession.token_key == _key(secret_hash(token)))
            )
            gone = db.scalar(statement)
            if gone is not None and slug in (None, gone.slug):
                return Deleted(gone.slug, gone.way_back)
        if slug is None or db.scalar(select(Study.id).where(Study.slug == slug)) is not None:
            return None
        gone = db.scalar(select(DeletedStudy).where(DeletedStudy.slug == slug))
        return None if gone is None else Deleted(gone.slug, None)


def sweep(app: AppContext) -> int:
    """Forget the sessions of studies that were deleted long ago; how many."""
    old = select(DeletedStudy.id).where(DeletedStudy.deleted_on <= app.now() - _CODE_KEPT)
    with app.database.write() as db:
        gone = db.scalars(
            delete(DeletedSession)
            .where(DeletedSession.deleted_study_id.in_(old))
            .returning(DeletedSession.id)
        ).all()
    return len(gone)


def _key(token_hash: str) -> str:
    """Not the hash that a backup of the study holds: the two cannot be joined without the token."""
    return hashlib.sha256(f"session of a deleted study:{token_hash}".encode()).hexdigest()
