"""Pilots: people try a study by a link of its own, before it counts.

The link is one secret for all whom an experimenter sends it to. Of it only a hash is kept. A pilot
is possible while the study is a draft, and while it is open; its sessions hold no place, weigh in
no balance of conditions and are given no completion code.
"""

from __future__ import annotations

import hmac

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.tables import Study

from . import audit, studies
from .errors import ConflictError, EntryLinkError
from .studio import Studio
from .tokens import new_secret, secret_hash

#: Pages of a pilot are at the addresses of the study's pages, after this.
PREFIX = "/pilot"


def path_of(slug: str, token: str) -> str:
    """The path of the link with this token."""
    return f"{PREFIX}/s/{slug}?entry={token}"


def make_link(studio: Studio, slug: str, actor: str = audit.COMMAND_LINE) -> str:
    """The token of a new link, shown this once. The one before it lets nobody in any more.

    Raises NotFoundError, or ConflictError where the study is closed.
    """
    token = new_secret()
    with studio.database.write() as session:
        study = _study(session, slug)
        if study.status == studies.CLOSED:
            raise ConflictError(f"expected a study that is a draft or open, and {slug!r} is closed")
        study.pilot_link_hash = secret_hash(token)
        audit.note(session, studio.now(), actor, "pilot link made", slug)
    return token


def end_link(studio: Studio, slug: str, actor: str = audit.COMMAND_LINE) -> None:
    """Let nobody into a pilot any more; who is in one goes on. Raises NotFoundError."""
    with studio.database.write() as session:
        study = _study(session, slug)
        if study.pilot_link_hash is not None:
            study.pilot_link_hash = None
            audit.note(session, studio.now(), actor, "pilot link ended", slug)


def has_link(session: Session, study_id: int) -> bool:
    """Whether there is a link that lets people into a pilot of the study."""
    return _hash(session, study_id) is not None


def require_link(session: Session, study: studies.StudyInfo, token: str | None) -> None:
    """Raises EntryLinkError unless this is the token of the study's present pilot link."""
    kept = _hash(session, study.id)
    if token is None or kept is None or not hmac.compare_digest(kept, secret_hash(token)):
        raise EntryLinkError(
            f"expected the present link of a pilot of the study {study.slug!r}", is_used=False
        )


def _hash(session: Session, study_id: int) -> str | None:
    return session.scalar(select(Study.pilot_link_hash).where(Study.id == study_id))


def _study(session: Session, slug: str) -> Study:
    studies.read(session, slug)
    return session.scalars(select(Study).where(Study.slug == slug).with_for_update()).one()
