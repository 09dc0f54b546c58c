"""The slugs of studies being made in the browser: derived, checked against those that are taken.

A draft that was copied from a study to take its place says so in a hidden file: nothing that a
browser sends can have such a name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from sqlalchemy import select

from app.storage.tables import Study
from app.study import beginning
from app.study.faults import Fault, UnreadableFileError
from app.study.files import read_text
from app.study.plan_source import STUDY_FILE

from . import slugs, studies
from .errors import ConflictError, SlugTakenError
from .studies import StudyInfo
from .studio import Studio

#: Holds the id of the study that a draft was copied from, to take its place.
ORIGIN = ".origin"


def of_title(studio: Studio, title: str, making: Iterable[Path]) -> str:
    """A slug made of the title that no study has, and none of the folders that are being made."""
    said = filter(None, map(_said, making))
    with studio.database.read() as session:
        return slugs.free(session, beginning.slug_of(title), said)


def of_copy(studio: Studio, study: StudyInfo, wanted: str) -> str:
    """The slug of a study's copy: its own, to take its place, or another one that is free.

    Raises ConflictError if it is taken, or if the study is no draft and so cannot be replaced.
    """
    if wanted == study.slug:
        if study.status != studies.DRAFT:
            raise ConflictError(
                f"expected another slug for a copy, and {wanted!r} is {study.status}"
            )
        return wanted
    slug = beginning.slug_of(wanted)
    with studio.database.read() as session:
        unused = slugs.free(session, slug)
    if unused != slug:
        raise SlugTakenError(f"expected another slug: {slug!r} is taken, and {unused!r} is free")
    return slug


def note_origin(folder: Path, study_id: int) -> None:
    """Keep which study the folder was copied from, to take its place."""
    (folder / ORIGIN).write_text(str(study_id), encoding="ascii")


def origin(folder: Path) -> int | None:
    """The id of the study that the folder was copied from, to take its place."""
    try:
        return int((folder / ORIGIN).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def replaces(studio: Studio, folder: Path, slug: str) -> bool:
    """Whether a study of this folder and slug takes the place of the draft it was copied from."""
    copied = origin(folder)
    with studio.database.read() as session:
        return copied is not None and copied == session.scalar(
            select(Study.id).where(Study.slug == slug, Study.status == studies.DRAFT)
        )


def fault(studio: Studio, folder: Path, slug: str) -> Fault | None:
    """What keeps a study of this folder from having this slug."""
    with studio.database.read() as session:
        earlier = session.scalar(select(Study).where(Study.slug == slug))
        if earlier is None and slug not in slugs.RESERVED:
            return None
        is_draft = earlier is not None and earlier.status == studies.DRAFT
        if is_draft and earlier is not None and earlier.id == origin(folder):
            return None
        unused = slugs.free(session, slug)
    how = "; to change that draft, begin on its page, at Manage" if is_draft else ""
    message = f"slug: expected one that no other study has, got {slug!r} ({unused!r} is free{how})"
    return Fault(STUDY_FILE, None, message)


def _said(folder: Path) -> str | None:
    try:
        text = read_text(folder, folder / STUDY_FILE)
    except UnreadableFileError:
        return None
    found = re.search(r"^slug:\s*[\"']?([a-z0-9-]+)", text, re.MULTILINE)
    return found and found[1]
