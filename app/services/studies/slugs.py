"""Which slugs are taken, and by what proof a study may take the place of a draft of its slug.

A slug is a name, and two studies may come to the same one: that alone never makes them the same
study. A draft makes way for the study that was copied from it to be changed, for the folder that it
was made of, and where that is asked for by name; otherwise another slug is needed.
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

#: What follows /studies/ in the addresses of other pages.
RESERVED = frozenset({"new"})
LONGEST = 60
#: Details of the audit trail's entry on a study's creation: the folder that it was made of.
FOLDER = "folder"
CREATED = "study created"


@dataclass(frozen=True)
class Proof:
    """What shows that a study is the same as the draft that it would replace.

    origin: the id of the draft study that its folder was copied from, to be changed. is_asked: its
    replacement was asked for by name.
    """

    origin: int | None = None
    is_asked: bool = False


NONE = Proof()


def folder_hash(folder: Path) -> str:
    """A folder on this machine, so that it can be recognised and its path is not told."""
    return hashlib.sha256(str(folder.resolve()).encode(errors="surrogateescape")).hexdigest()[:32]


def require_same(db: Session, earlier: Study, folder: str, proof: Proof = NONE) -> None:
    """Raises SlugTakenError unless this draft is shown to be the same study.

    folder: the mark of the folder that the new one is made of (`folder_hash`).
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


def remark(app: AppContext, slug: str, folder: str) -> str | None:
    """What to know of the slug before a study is made of this folder; None if it is free."""
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
    """The account whose study it is; None for one of the command line's."""
    return db.scalar(
        select(StudyAccess.account_id).where(
            StudyAccess.study_id == study_id, StudyAccess.access == "owner"
        )
    )


def free(db: Session, wanted: str, others: Iterable[str] = ()) -> str:
    """The slug, or with a number behind it the first that no study and none of `others` has."""
    taken = set(db.scalars(select(Study.slug))) | RESERVED | set(others)
    if wanted not in taken:
        return wanted
    for number in count(2):
        slug = f"{wanted[: LONGEST - 5].rstrip('-')}-{number}"
        if slug not in taken:
            return slug
    raise AssertionError("numbers do not end")
