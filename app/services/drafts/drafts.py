"""Use cases of study drafts: begin, copy, edit, check, and create a study from one.

A draft is a study folder below the uploads folder, visible to the account that began it only. Its
check reports what `pbpo study check` reports for the same folder.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from app.services import jobs
from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.runtime import disk_quota
from app.services.runtime.errors import (
    ChangedMeanwhileError,
    ConflictError,
    ForbiddenError,
    NoRoomError,
    NotFoundError,
)
from app.services.runtime.ids import new_public_id
from app.services.studies import access, folder_export, repository, slugs
from app.storage.models.records import StudyDraft
from app.study.file_lookup import FileLookup
from app.study.files import read_bytes, read_text
from app.study.folder import StudyFolder
from app.study.plan_source import STUDY_FILE
from app.study.recordings import PLAYABLE
from app.study.table_encoding import decode
from app.study.tables import TABLE_ENDINGS
from app.study.text_diff import text_hash
from app.study.validation_errors import Fault, UnreadableFileError, grouped
from app.study.yaml_slips import mend

from . import files as draft_files
from . import slugs as draft_slugs
from . import table_intake, transcode_job, uploads
from .files import Sent
from .steps import is_placeholder
from .uploads import UploadRefusedError

#: Endings of files that can be edited on a page.
TEXT_ENDINGS = (".yaml", ".csv", ".tsv", ".md", ".txt", ".po")
#: Characters of a text file; no plan or consent is longer.
LONGEST_TEXT = 1_000_000
#: Characters of a draft's name.
LONGEST_NAME = 100


@dataclass(frozen=True)
class Draft:
    """A study draft and the folder of its files."""

    public_id: str
    name: str
    folder: Path
    changed_at: datetime


@dataclass(frozen=True)
class DraftFile:
    """A file of a draft. name: its path within the folder. size: in bytes."""

    name: str
    size: int
    is_text: bool


@dataclass(frozen=True)
class Checked:
    """The result of a check: the study, or the faults by file.

    remarks: how tables were understood, and what is worth knowing of videos. unused: files that
    nothing names. notes: what was done with the files when they were stored. can_take_parameters:
    whether the plan's parameters are others than those of its table. can_mend: whether the slips of
    YAML in the plan can be put right. doubts: what a person would ask before it is opened.
    """

    study: StudyFolder | None
    faults: Mapping[str, Sequence[Fault]]
    remarks: Sequence[Fault] = ()
    unused: Sequence[str] = ()
    notes: Sequence[str] = ()
    can_take_parameters: bool = False
    can_mend: bool = False
    doubts: Sequence[Fault] = ()

    @property
    def can_be_transcoded(self) -> int:
        """The number of videos that some browser cannot play."""
        expected_values = (
            fault.parts.expected for faults in self.faults.values() for fault in faults
        )
        return sum(expected == PLAYABLE for expected in expected_values)

    @property
    def number(self) -> int:
        """The number of faults; those of one cause count once, and placeholders not at all."""
        wrong = [
            [fault for fault in faults if not is_placeholder(fault)]
            for faults in self.faults.values()
        ]
        return sum(len(grouped(faults)) for faults in wrong)

    @property
    def to_fill(self) -> int:
        """The number of places that the example left for the study's own words."""
        return sum(is_placeholder(fault) for faults in self.faults.values() for fault in faults)


def begin(app: AppContext, caller: Principal, name: str, sent: Sequence[Sent] = ()) -> Draft:
    """Create a draft from uploaded files: a zip of a study folder, or videos and a CSV, or nothing.

    Files that a study folder needs are added from the example, unless a zip holds a plan. Raises
    UploadRefusedError, NoRoomError, or ForbiddenError.
    """
    if not access.may_make_studies(caller):
        raise ForbiddenError(f"{caller.email} ({caller.role.value}) may not make studies")
    require_room(app, caller)
    name = " ".join(name.split())[:LONGEST_NAME] or _name_of(sent) or "A new study"
    public_id = new_public_id()
    draft = Draft(public_id, name, folder_of(app, public_id), app.now())
    draft.folder.mkdir(parents=True, mode=0o700)
    try:
        names = draft_files.store(draft.folder, sent, _limit(app, caller, draft))
        table_intake.take(draft.folder, names)
        if not (draft.folder / STUDY_FILE).is_file():
            draft_files.add_scaffold(
                draft.folder,
                name,
                draft_slugs.of_title(app, name, (one.folder for one in list_drafts(app, caller))),
            )
        _keep_row(app, caller, draft, "draft begun")
    except BaseException:
        shutil.rmtree(draft.folder, ignore_errors=True)
        raise
    return draft


def clone(app: AppContext, caller: Principal, study: repository.StudyInfo, new_slug: str) -> Draft:
    """Create a draft as a copy of a study, under a new slug or to replace the study itself.

    new_slug: empty, or the study's own slug, for a draft that is to replace it. Raises
    SlugTakenError if another study has the slug, ConflictError if a video is missing or the study
    cannot be replaced, NoRoomError, or ForbiddenError.
    """
    if not access.may_make_studies(caller):
        raise ForbiddenError(f"{caller.email} ({caller.role.value}) may not make studies")
    is_change = not new_slug or new_slug == study.slug
    require_room(app, caller)
    slug = draft_slugs.of_copy(app, study, study.slug if is_change else new_slug)
    public_id = new_public_id()
    draft = Draft(public_id, slug, folder_of(app, public_id), app.now())
    try:
        folder_export.write_folder(app, study.slug, draft.folder, slug)
        if is_change:
            draft_slugs.note_origin(draft.folder, study.id)
        _keep_row(app, caller, draft, "study cloned", study.slug)
    except BaseException:
        shutil.rmtree(draft.folder, ignore_errors=True)
        raise
    return draft


def list_drafts(app: AppContext, caller: Principal) -> list[Draft]:
    """The caller's drafts, the newest first."""
    with app.database.read() as db:
        rows = db.scalars(
            select(StudyDraft)
            .where(StudyDraft.account_id == caller.account_id)
            .order_by(StudyDraft.changed_at.desc(), StudyDraft.id.desc())
        )
        return [_draft(app, row) for row in rows]


def find(app: AppContext, caller: Principal, public_id: str, *, whole: bool = True) -> Draft:
    """The caller's draft with this id. Raises NotFoundError.

    whole: also raise it if the draft's files are not on this server.
    """
    with app.database.read() as db:
        row = db.scalar(
            select(StudyDraft).where(
                StudyDraft.public_id == public_id, StudyDraft.account_id == caller.account_id
            )
        )
    if row is None or not access.may_make_studies(caller):
        raise NotFoundError("there is no such study being made")
    draft = _draft(app, row)
    if whole and not draft.folder.is_dir():
        # Several servers may each have a data folder of their own.
        raise NotFoundError(
            "the files of this study are not in the data folder of the server that answers; it was"
            " begun at another one, or they were lost"
        )
    return draft


def files(draft: Draft) -> list[DraftFile]:
    """The files of a draft by name, texts first, without hidden ones."""
    found = [
        DraftFile(
            path.relative_to(draft.folder).as_posix(),
            path.stat().st_size,
            path.suffix.lower() in TEXT_ENDINGS,
        )
        for path in sorted(draft.folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    return sorted(found, key=lambda file: (not file.is_text, file.name != STUDY_FILE, file.name))


def require_room(app: AppContext, caller: Principal, upload_bytes: int = 0) -> None:
    """Raise NoRoomError if the caller has the maximum number of drafts, or the disk is too full.

    upload_bytes: the bytes about to be uploaded.
    """
    disk_quota.require(app.settings, app.settings.uploads_dir, upload_bytes)
    most = app.settings.drafts_per_account
    with app.database.read() as db:
        number = _number(db, caller)
    if number >= most:
        raise NoRoomError(
            f"expected at most {most} studies being made by an account, and you are making"
            f" {number}: create or throw away one of them first"
        )


def _number(db: Session, caller: Principal) -> int:
    return (
        db.scalar(
            select(func.count(StudyDraft.id)).where(StudyDraft.account_id == caller.account_id)
        )
        or 0
    )


def add(app: AppContext, caller: Principal, draft: Draft, sent: Sequence[Sent]) -> list[str]:
    """Add uploaded files to a draft and return their names; zips are unpacked, old files replaced.

    Raises UploadRefusedError or NoRoomError.
    """
    if not sent:
        raise UploadRefusedError(["Expected a file, got none."])
    disk_quota.require(app.settings, draft.folder)
    names = draft_files.store(draft.folder, sent, _limit(app, caller, draft))
    table_intake.take(draft.folder, names)
    _changed(app, draft)
    return names


def remove(app: AppContext, draft: Draft, name: str) -> None:
    """Delete a file of a draft. Raises NotFoundError."""
    _existing(draft, name).unlink()
    _changed(app, draft)


def text_of(draft: Draft, name: str) -> str:
    """The content of a text file; empty if it does not exist. Raises UploadRefusedError."""
    path = _text_path(draft, name)
    try:
        return read_text(draft.folder, path) if path.exists() else ""
    except UnreadableFileError as error:
        if path.suffix.lower() in TABLE_ENDINGS:
            return _decoded(draft, name, path)
        raise UploadRefusedError([f"{name}: {error}."]) from None


def _decoded(draft: Draft, name: str, path: Path) -> str:
    """The text of a table in another encoding."""
    try:
        return decode(read_bytes(draft.folder, path), FileLookup(draft.folder).names).text
    except UnreadableFileError as error:
        raise UploadRefusedError([f"{name}: {error}."]) from None


def write_text(
    app: AppContext, draft: Draft, name: str, text: str, base: str | None = None
) -> None:
    """Write a text file of the draft.

    base: the `text_diff.text_hash` of the text that the edit started from. Raises
    ChangedMeanwhileError if the file has another text by now, or UploadRefusedError.
    """
    written = text.replace("\r\n", "\n")
    path = _text_path(draft, name)
    with app.database.write() as db:
        # The update locks the row, so that parallel edits see each other's text.
        _touch(db, app, draft)
        if base is not None:
            there = text_of(draft, name)
            if text_hash(there) != base and there != written:
                raise ChangedMeanwhileError(
                    f"expected {name} as it was when this page was opened, and it was changed"
                )
        uploads.write_file(io.BytesIO(written.encode("utf-8", "replace")), path, LONGEST_TEXT)
        if path.suffix.lower() in TABLE_ENDINGS:
            table_intake.take(draft.folder, [path.relative_to(draft.folder).as_posix()])


def mend_plan(app: AppContext, draft: Draft) -> None:
    """Write the plan as it reads once the slips of YAML in it are mended.

    Raises UploadRefusedError if they cannot be.
    """
    mended = mend(text_of(draft, STUDY_FILE))
    if mended is None:
        raise UploadRefusedError([f"Expected slips in {STUDY_FILE} that can be put right."])
    write_text(app, draft, STUDY_FILE, mended.text)


def take_parameters(app: AppContext, draft: Draft) -> None:
    """Write the parameters of the draft's table into its plan.

    Raises UploadRefusedError if there is no such table, or if the plan cannot be edited.
    """
    if not table_intake.follow(draft.folder, is_asked=True):
        raise UploadRefusedError(
            [f"Expected a table with parameters, and a {STUDY_FILE} that can be read."]
        )
    _changed(app, draft)


def check(app: AppContext, draft: Draft) -> Checked:
    """Validate a draft, including whether its slug is free."""
    found = repository.examine_folder(str(draft.folder))
    faults: dict[str, list[Fault]] = {}
    for fault in found.faults:
        faults.setdefault(fault.file, []).append(fault)
    study = found.study
    taken = draft_slugs.fault(app, draft.folder, study.plan.slug) if study else None
    if taken is not None:
        study, faults = None, {STUDY_FILE: [taken]}
    return Checked(
        study,
        faults,
        found.remarks,
        found.unused,
        [
            *draft_files.upload_notes(draft.folder),
            *table_intake.notes(draft.folder).values(),
        ],
        table_intake.differs(draft.folder, found.data),
        found.can_mend,
        repository.doubts_on(study) if study else (),
    )


def replaces(app: AppContext, draft: Draft, slug: str) -> bool:
    """Whether creating the draft's study replaces the study from which it was copied."""
    return draft_slugs.replaces(app, draft.folder, slug)


def transcode(app: AppContext, caller: Principal, draft: Draft) -> jobs.JobInfo:
    """Enqueue a job that transcodes the draft's videos that some browser cannot play."""
    _changed(app, draft)
    return jobs.enqueue(app, caller, transcode_job.KIND, {"draft": draft.public_id})


def create_study(app: AppContext, caller: Principal, draft: Draft) -> repository.StudyInfo:
    """Create a study with status draft, owned by the caller, and delete this draft.

    Raises StudyFaults, or ConflictError if the slug is taken.
    """
    folder = repository.load_folder(str(draft.folder))
    info = repository.create(
        app,
        folder,
        caller.account_id,
        actor=caller.email,
        may_replace=lambda db, study_id: access.may_change(db, caller, study_id),
        proof=slugs.Proof(origin=draft_slugs.origin(draft.folder)),
    )
    discard(app, draft)
    return info


def discard(app: AppContext, draft: Draft) -> None:
    """Delete a draft with its files."""
    with app.database.write() as db:
        db.execute(delete(StudyDraft).where(StudyDraft.public_id == draft.public_id))
    shutil.rmtree(draft.folder, ignore_errors=True)


def _keep_row(
    app: AppContext, caller: Principal, draft: Draft, action: str, of: str | None = None
) -> None:
    now = draft.changed_at
    with app.database.write() as db:
        # Locked, so that drafts begun in parallel count each other.
        accounts.lock(db, caller.account_id)
        if _number(db, caller) >= app.settings.drafts_per_account:
            raise NoRoomError("expected fewer studies being made: another was begun just now")
        db.add(
            StudyDraft(
                public_id=draft.public_id,
                account_id=caller.account_id,
                name=draft.name,
                created_at=now,
                changed_at=now,
            )
        )
        audit_log.note(db, now, caller.email, action, of, draft=draft.public_id)


def _draft(app: AppContext, row: StudyDraft) -> Draft:
    return Draft(row.public_id, row.name, folder_of(app, row.public_id), row.changed_at)


def folder_of(app: AppContext, public_id: str) -> Path:
    """The folder with the files of the draft of this id."""
    # Resolved, since the check compares resolved paths of its files with it.
    return (app.settings.uploads_dir / "drafts" / public_id).resolve()


def _changed(app: AppContext, draft: Draft) -> None:
    with app.database.write() as db:
        _touch(db, app, draft)


def _touch(db: Session, app: AppContext, draft: Draft) -> None:
    db.execute(
        update(StudyDraft)
        .where(StudyDraft.public_id == draft.public_id)
        .values(changed_at=app.now())
    )


def _limit(app: AppContext, caller: Principal, draft: Draft) -> int:
    """The bytes that this draft may take: the limit per study, or the rest of the caller's limit.

    Raises NoRoomError if the caller's other drafts use up their limit.
    """
    others = sum(
        uploads.size_of(one.folder)
        for one in list_drafts(app, caller)
        if one.public_id != draft.public_id
    )
    left = app.settings.account_limit_mb * 1_000_000 - others
    if left <= 0:
        raise NoRoomError(
            f"expected at most {app.settings.account_limit_mb:,} MB in all studies that you are"
            f" making, and they take {others / 1e6:,.0f} MB: create or throw away one of them first"
        )
    return min(app.settings.upload_limit_mb * 1_000_000, left)


def _name_of(sent: Sequence[Sent]) -> str:
    zips = [PurePosixPath(one.name) for one in sent if draft_files.is_zip(one)]
    return zips[0].stem[:LONGEST_NAME] if zips else ""


def _existing(draft: Draft, name: str) -> Path:
    path = draft.folder / uploads.safe_name(name)
    if not path.is_file():
        raise NotFoundError(f"there is no file {name!r} in this study")
    return path


def _text_path(draft: Draft, name: str) -> Path:
    path = draft.folder / uploads.safe_name(name)
    if path.suffix.lower() not in TEXT_ENDINGS or path.is_dir():
        raise ConflictError(f"expected a text such as {STUDY_FILE} to be changed, got {name!r}")
    return path
