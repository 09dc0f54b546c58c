"""Pilot links, with which people try a study before it counts.

One secret link per study is shared by all pilot participants; only its hash is stored. A pilot is
possible while the study is a draft or open. Its sessions take no place, do not count in the balance
of conditions and get no completion code.
"""

from __future__ import annotations

import hmac

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, EntryLinkError
from app.services.runtime.ids import new_secret, secret_hash
from app.services.studies import repository
from app.storage.models.studies import Study

#: The prefix of a pilot's pages before the paths of the study's pages.
PREFIX = "/pilot"


def path_of(slug: str, token: str) -> str:
    """The path of the link with this token."""
    return f"{PREFIX}/s/{slug}?entry={token}"


def make_link(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> str:
    """Replace the study's pilot link and return the token of the new one, which is not stored.

    Raises NotFoundError, or ConflictError if the study is closed.
    """
    token = new_secret()
    with app.database.write() as db:
        study = _study(db, slug)
        if study.status == repository.CLOSED:
            raise ConflictError(f"expected a study that is a draft or open, and {slug!r} is closed")
        study.pilot_link_hash = secret_hash(token)
        audit_log.note(db, app.now(), actor, "pilot link made", slug)
    return token


def end_link(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """Delete the pilot link; pilot sessions under way continue. Raises NotFoundError."""
    with app.database.write() as db:
        study = _study(db, slug)
        if study.pilot_link_hash is not None:
            study.pilot_link_hash = None
            audit_log.note(db, app.now(), actor, "pilot link ended", slug)


def has_link(db: Session, study_id: int) -> bool:
    """Whether the study has a pilot link."""
    return _hash(db, study_id) is not None


def require_link(db: Session, study: repository.StudyInfo, token: str | None) -> None:
    """Raise EntryLinkError unless this is the token of the study's current pilot link."""
    kept = _hash(db, study.id)
    if token is None or kept is None or not hmac.compare_digest(kept, secret_hash(token)):
        raise EntryLinkError(
            f"expected the present link of a pilot of the study {study.slug!r}", is_used=False
        )


def _hash(db: Session, study_id: int) -> str | None:
    return db.scalar(select(Study.pilot_link_hash).where(Study.id == study_id))


def _study(db: Session, slug: str) -> Study:
    repository.read(db, slug)
    return db.scalars(select(Study).where(Study.slug == slug).with_for_update()).one()
