"""Revises the texts of a study under way, as a new version of its plan.

A plan and its recordings are frozen once the study opens, but texts may have to change, for example
when an ethics board asks for another sentence. If the consent has changed, `sessions.consents` asks
participants under way to agree again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.recordings import recordings
from app.services.runtime.errors import ChangedMeanwhileError, ConflictError
from app.storage.models.studies import Candidate, PlanVersion, Recording, Study
from app.study.folder import StudyFolder, text_faults
from app.study.placeholders import filled
from app.study.plan import plan_hash
from app.study.recordings import RecordingRow
from app.study.validation_errors import StudyFaults

from . import repository
from .repository import StudyInfo


@dataclass(frozen=True)
class Version:
    """One version of a study's plan and texts."""

    version: int
    plan_hash: str
    created_at: datetime


def revise(app: AppContext, folder: StudyFolder, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """Give a study the texts of this folder. The same texts again change nothing.

    Raises NotFoundError, or ConflictError if anything other than the texts differs.
    """
    slug = folder.plan.slug
    with app.database.write() as db:
        # Locked, so that parallel calls create one version after the other.
        repository.lock_study(db, slug)
        before = repository.read(db, slug)
        _require_the_same(db, before, folder)
        texts = {language: dict(named) for language, named in folder.texts.items()}
        if texts == before.texts:
            return before
        return _add_version(app, db, before, texts, folder.recordings, actor)


def revise_texts(
    app: AppContext,
    slug: str,
    texts: Mapping[str, Mapping[str, str]],
    actor: str,
    base: str | None = None,
) -> StudyInfo:
    """Give a study these texts from its page. The same texts again change nothing.

    base: the hash of the plan whose texts the page showed. Raises NotFoundError,
    ChangedMeanwhileError if the study has another plan by now, or StudyFaults with every text that
    is missing or incomplete.
    """
    with app.database.write() as db:
        repository.lock_study(db, slug)
        before = repository.read(db, slug)
        given = {
            language: {
                name: texts.get(language, {}).get(name, "").replace("\r\n", "\n") for name in named
            }
            for language, named in before.texts.items()
        }
        if base is not None and base != before.plan_hash and given != before.texts:
            raise ChangedMeanwhileError(
                "expected the texts as they were when this page was opened, and they were revised"
            )
        faults = [
            fault
            for language, named in given.items()
            for name, text in named.items()
            for fault in text_faults(language, name, text)
        ]
        if faults:
            raise StudyFaults(faults)
        given = {
            language: {name: filled(text, before.plan) for name, text in named.items()}
            for language, named in given.items()
        }
        if given == before.texts:
            return before
        return _add_version(app, db, before, given, _stored_rows(db, before), actor)


def texts_of(app: AppContext, study: StudyInfo, digest: str) -> repository.Texts | None:
    """The texts of the study's version with this hash; None if there is no such version."""
    with app.database.read() as db:
        texts: repository.Texts | None = db.scalar(
            select(PlanVersion.texts)
            .where(PlanVersion.study_id == study.id, PlanVersion.plan_hash == digest)
            .order_by(PlanVersion.version.desc())
            .limit(1)
        )
        return texts


def versions(app: AppContext, study: StudyInfo) -> list[Version]:
    """All versions of the study's plan, the newest first."""
    with app.database.read() as db:
        rows = db.scalars(
            select(PlanVersion)
            .where(PlanVersion.study_id == study.id)
            .order_by(PlanVersion.version.desc())
        )
        return [Version(row.version, row.plan_hash, row.created_at) for row in rows]


def _add_version(
    app: AppContext,
    db: Session,
    before: StudyInfo,
    texts: Mapping[str, Mapping[str, str]],
    rows: Sequence[RecordingRow],
    actor: str,
) -> StudyInfo:
    study = db.scalars(select(Study).where(Study.slug == before.slug)).one()
    version = PlanVersion(
        version=before.plan_version + 1,
        plan_hash=plan_hash(before.plan, texts, rows),
        plan=before.plan.model_dump(mode="json"),
        texts={language: dict(named) for language, named in texts.items()},
        created_at=app.now(),
    )
    study.plans.append(version)
    audit_log.note(
        db,
        app.now(),
        actor,
        "texts revised",
        before.slug,
        version=version.version,
        plan_hash=version.plan_hash,
    )
    db.flush()
    return repository.read(db, before.slug)


def _stored_rows(db: Session, study: StudyInfo) -> list[RecordingRow]:
    """The study's own recordings as rows of its tables; none of those that machines made."""
    names = [parameter.name for parameter in study.plan.parameters]
    found = db.execute(
        select(Candidate, Recording)
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(
            Candidate.study_id == study.id,
            Candidate.environment.in_(_with_table(study)),
            Recording.source == recordings.FILE,
        )
        .order_by(Candidate.id, Recording.run_index)
    )
    return [
        RecordingRow(
            environment=candidate.environment,
            candidate=tuple(candidate.parameters[name] for name in names),
            file=recording.file or "",
            sha256=recordings.own_sha256(recording.locator),
            duration_s=recording.duration_s,
            score=recording.score,
        )
        for candidate, recording in found
    ]


def _with_table(study: StudyInfo) -> list[str]:
    """The environments whose recordings are part of the plan's hash."""
    return [name for name, one in study.plan.environments.items() if one.has_table]


def _require_the_same(db: Session, before: StudyInfo, folder: StudyFolder) -> None:
    if before.plan != folder.plan:
        raise ConflictError(
            f"expected the plan that {before.slug!r} has: once a study is created, only its texts"
            " may change"
        )
    stored = db.execute(
        select(Candidate.environment, Recording.locator)
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(
            Candidate.study_id == before.id,
            Candidate.environment.in_(_with_table(before)),
            Recording.source == recordings.FILE,
        )
    )
    held = {(environment, recordings.own_sha256(locator)) for environment, locator in stored}
    if held != {(row.environment, row.sha256) for row in folder.recordings}:
        raise ConflictError(
            f"expected the recordings that {before.slug!r} has: once a study is created, only its"
            " texts may change"
        )
