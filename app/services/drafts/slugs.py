"""Slugs of study drafts: derived from titles, and checked against those that are taken.

A draft that was copied from a study to replace it records this in a hidden file, whose name uploads
cannot have.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from sqlalchemy import select

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, SlugTakenError
from app.services.studies import repository, slugs
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Study
from app.study import draft_plan
from app.study.files import read_text
from app.study.plan_source import STUDY_FILE
from app.study.validation_errors import Fault, UnreadableFileError

#: File with the id of the study that the draft is to replace.
ORIGIN = ".origin"


def of_title(app: AppContext, title: str, making: Iterable[Path]) -> str:
    """A slug derived from the title that no study and none of these draft folders has."""
    said = filter(None, map(_slug_in_plan, making))
    with app.database.read() as db:
        return slugs.free(db, draft_plan.slug_of(title), said)


def of_copy(app: AppContext, study: StudyInfo, wanted: str) -> str:
    """The slug of a study's copy: the study's own to replace it, or `wanted` if it is free.

    Raises SlugTakenError if it is taken, and ConflictError if the study is to be replaced and is no
    draft.
    """
    if wanted == study.slug:
        if study.status != repository.DRAFT:
            raise ConflictError(
                f"expected another slug for a copy, and {wanted!r} is {study.status}"
            )
        return wanted
    slug = draft_plan.slug_of(wanted)
    with app.database.read() as db:
        unused = slugs.free(db, slug)
    if unused != slug:
        raise SlugTakenError(f"expected another slug: {slug!r} is taken, and {unused!r} is free")
    return slug


def note_origin(folder: Path, study_id: int) -> None:
    """Record the study that this folder is to replace."""
    (folder / ORIGIN).write_text(str(study_id), encoding="ascii")


def origin(folder: Path) -> int | None:
    """The id of the study that this folder is to replace, or None."""
    try:
        return int((folder / ORIGIN).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def replaces(app: AppContext, folder: Path, slug: str) -> bool:
    """Whether a study from this folder with this slug replaces the draft that was copied."""
    copied = origin(folder)
    with app.database.read() as db:
        return copied is not None and copied == db.scalar(
            select(Study.id).where(Study.slug == slug, Study.status == repository.DRAFT)
        )


def fault(app: AppContext, folder: Path, slug: str) -> Fault | None:
    """The fault that this slug is taken; None if a study from this folder can have it."""
    with app.database.read() as db:
        earlier = db.scalar(select(Study).where(Study.slug == slug))
        if earlier is None and slug not in slugs.RESERVED:
            return None
        is_draft = earlier is not None and earlier.status == repository.DRAFT
        if is_draft and earlier is not None and earlier.id == origin(folder):
            return None
        unused = slugs.free(db, slug)
    how = "; to change that draft, begin on its page, at Manage" if is_draft else ""
    message = f"slug: expected one that no other study has, got {slug!r} ({unused!r} is free{how})"
    return Fault(STUDY_FILE, None, message)


def _slug_in_plan(folder: Path) -> str | None:
    """The slug in the folder's plan, valid or not; None if there is none."""
    try:
        text = read_text(folder, folder / STUDY_FILE)
    except UnreadableFileError:
        return None
    found = re.search(r"^slug:\s*[\"']?([a-z0-9-]+)", text, re.MULTILINE)
    return found and found[1]
