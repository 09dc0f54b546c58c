"""Slugs of studies: which are taken, and when a new study may replace a draft with its slug.

Two different studies may have the same name, so the slug alone does not identify a draft. A draft
is replaced by the study that was copied from it for a change, by a study from the same folder, or
on explicit request; otherwise another slug is needed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import SlugTakenError
from app.storage.models.accounts import StudyAccess
from app.storage.models.records import AuditEvent
from app.storage.models.studies import Study

#: Path segments after /studies/ that belong to other pages.
RESERVED = frozenset({"new"})
LONGEST = 60
#: Audit log entry of a study's creation, and its detail with the hash of the source folder.
FOLDER = "folder"
CREATED = "study created"


@dataclass(frozen=True)
class Proof:
    """Evidence that a new study is the same as the draft that it would replace.

    origin: the id of the draft from which its folder was copied for a change. is_asked: whether the
    replacement was requested explicitly.
    """

    origin: int | None = None
    is_asked: bool = False


NONE = Proof()


def folder_hash(folder: Path) -> str:
    """A hash of the folder's absolute path: it identifies the folder without storing the path."""
    return hashlib.sha256(str(folder.resolve()).encode(errors="surrogateescape")).hexdigest()[:32]


def require_same(db: Session, earlier: Study, folder: str, proof: Proof = NONE) -> None:
    """Raise SlugTakenError unless this draft is proven to be the same study.

    folder: the `folder_hash` of the new study's source folder.
    """
    if proof.is_asked or (proof.origin is not None and proof.origin == earlier.id):
        return
    made = db.scalar(
        select(AuditEvent.details)
        .where(AuditEvent.study_slug == earlier.slug, AuditEvent.action == CREATED)
        .order_by(AuditEvent.id.desc())
        .limit(1)
    )
    if made is not None and made.get(FOLDER) == folder:
        return
    raise SlugTakenError(
        f"expected another slug: a draft has {earlier.slug!r} already, and it is kept as it is"
    )


def unavailable_reason(app: AppContext, slug: str, folder: str) -> str | None:
    """A sentence on why a study from this folder cannot have the slug; None if it can.

    folder: its `folder_hash`.
    """
    with app.database.read() as db:
        earlier = db.scalar(select(Study).where(Study.slug == slug))
        if earlier is None:
            return None
        if earlier.status != "draft":
            return f"the slug is taken by a study that is {earlier.status}"
        try:
            require_same(db, earlier, folder)
        except SlugTakenError:
            return "the slug is taken by a draft, which another study does not replace unasked"
    return None


def owner_of(db: Session, study_id: int) -> int | None:
    """The id of the account that owns the study; None if it was created on the command line."""
    return db.scalar(
        select(StudyAccess.account_id).where(
            StudyAccess.study_id == study_id, StudyAccess.access == "owner"
        )
    )


def free(db: Session, wanted: str, others: Iterable[str] = ()) -> str:
    """`wanted` if no study and none of `others` has it, else the first free slug with a number."""
    taken = set(db.scalars(select(Study.slug))) | RESERVED | set(others)
    if wanted not in taken:
        return wanted
    for number in count(2):
        slug = f"{wanted[: LONGEST - 5].rstrip('-')}-{number}"
        if slug not in taken:
            return slug
    raise AssertionError("numbers do not end")
