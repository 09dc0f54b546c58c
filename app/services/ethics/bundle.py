"""The ethics bundle: all documents for an ethics board as one reproducible zip."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import select

from app import __version__
from app.pbbo import ENGINE_VERSION
from app.services import jobs
from app.services.accounts import audit_log
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.runtime import disk_quota
from app.services.runtime.errors import NotFoundError
from app.services.studies import sharing
from app.services.studies.repository import StudyInfo, stored_plan
from app.storage.models.studies import PlanVersion, Study
from app.study import markdown as study_markdown
from app.study.folder import text_path

from . import bundle_job, data_inventory

#: The texts of a study in the order in which participants read them.
ORDER = ("welcome", "consent", "instructions", "debrief")


#: Age after which files staged for a job are deleted.
_STAGED_FOR = timedelta(days=7)


@dataclass(frozen=True)
class Text:
    """One text in one language. consent_version: of the consent only, as stored with consents."""

    plan_version: int
    language: str
    name: str
    sha256: str
    consent_version: str | None
    markdown: str


@dataclass(frozen=True)
class Version:
    """One version of the plan and its texts."""

    number: int
    plan_hash: str
    created_at: datetime


def versions(app: AppContext, study: StudyInfo) -> list[Version]:
    """All versions of the plan, oldest first."""
    return [Version(row.version, row.plan_hash, row.created_at) for row in _versions(app, study)]


def texts_of(app: AppContext, study: StudyInfo) -> list[Text]:
    """All texts of all versions in all languages."""
    return [
        Text(
            row.version,
            language,
            name,
            hashlib.sha256(markdown.encode()).hexdigest(),
            study_markdown.consent_version(markdown) if name == "consent" else None,
            markdown,
        )
        for row in _versions(app, study)
        for language in stored_plan(row).languages
        for name, markdown in sorted(row.texts[language].items(), key=_place)
    ]


def documents(app: AppContext, study: StudyInfo) -> dict[str, bytes]:
    """The files of the bundle by name, without the pages."""
    found = {
        text_path(f"version-{text.plan_version}/{text.language}", text.name): text.markdown.encode()
        for text in texts_of(app, study)
    }
    found["stored_fields.csv"] = data_inventory.as_csv(data_inventory.fields(study.plan))
    found["plan.json"] = _json(study.plan.model_dump(mode="json"))
    found["versions.json"] = _json(_versions_said(app, study))
    return found


@dataclass(frozen=True)
class BundleInfo:
    """A finished bundle. made_at: its modification time."""

    path: Path
    made_at: datetime


def finished_bundle(app: AppContext, study: StudyInfo) -> BundleInfo | None:
    """The study's finished bundle; None if there is none yet."""
    path = bundle_job.bundle_path(app.settings, study.id)
    try:
        return BundleInfo(path, datetime.fromtimestamp(path.stat().st_mtime, UTC))
    except FileNotFoundError:
        return None


def request_bundle(
    app: AppContext, caller: Principal, study: StudyInfo, pages: Mapping[str, str]
) -> jobs.JobInfo:
    """Stage the files and enqueue the job that makes the bundle.

    pages: HTML of every page by `LANGUAGE/NAME`. Raises NoRoomError.
    """
    disk_quota.require(app.settings, bundle_job.folder(app.settings))
    files = {f"{bundle_job.SCREENS}/{name}.html": html.encode() for name, html in pages.items()}
    files.update(documents(app, study))
    laid = bundle_job.stage_files(app.settings, files, caller.account_id)
    audit_log.note_alone(app, caller.email, "ethics bundle asked for", study.slug, files=len(files))
    return jobs.enqueue(
        app, caller, bundle_job.KIND, {"laid": laid, "study_id": study.id}, study_id=study.id
    )


def under_way(app: AppContext, caller: Principal, study: StudyInfo) -> jobs.JobInfo | None:
    """The newest job for the study's bundle if it is the caller's, otherwise None."""
    job = jobs.newest(app, bundle_job.KIND, study_id=study.id)
    try:
        return None if job is None else jobs.status(app, caller, job.public_id)
    except NotFoundError:
        return None


def delete_leftovers(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete bundles of deleted studies and old staged files; returns the number of deletions.

    stop: called before each; True ends the cleanup.
    """
    folder = bundle_job.folder(app.settings)
    with app.database.read() as db:
        there = {str(study_id) for study_id in db.scalars(select(Study.id))}
    gone = 0
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if stop():
            break
        age = app.now() - datetime.fromtimestamp(path.stat().st_mtime, UTC)
        if path.is_dir() and age > _STAGED_FOR:
            shutil.rmtree(path, ignore_errors=True)
        elif path.suffix == ".zip" and path.stem not in there:
            path.unlink(missing_ok=True)
        else:
            continue
        gone += 1
    return gone


def _versions_said(app: AppContext, study: StudyInfo) -> dict[str, object]:
    return {
        "study": study.slug,
        "program": f"PBPO Studio {__version__}",
        "method": f"preference optimiser {ENGINE_VERSION}",
        "versions": [
            {
                "version": version.number,
                "plan_hash": version.plan_hash,
                "made_at": version.created_at.isoformat(timespec="seconds"),
            }
            for version in versions(app, study)
        ],
        "texts": [
            {
                "version": text.plan_version,
                "language": text.language,
                "text": text.name,
                "sha256": text.sha256,
                "consent_version": text.consent_version,
            }
            for text in texts_of(app, study)
        ],
        "who_has_access": [
            {"account": member.email, "as": "owner" if member.is_owner else "shared with"}
            for member in sharing.members(app, study.slug)
        ],
    }


def _versions(app: AppContext, study: StudyInfo) -> list[PlanVersion]:
    statement = (
        select(PlanVersion).where(PlanVersion.study_id == study.id).order_by(PlanVersion.version)
    )
    with app.database.read() as db:
        return list(db.scalars(statement))


def _place(named: tuple[str, str]) -> tuple[int, str]:
    name = named[0]
    return (ORDER.index(name) if name in ORDER else len(ORDER), name)


def _json(value: object) -> bytes:
    return (json.dumps(value, indent=2, ensure_ascii=False, sort_keys=True) + "\n").encode()
