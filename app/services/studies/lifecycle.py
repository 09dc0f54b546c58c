"""The lifecycle of a study after its creation: pause, resume, switch conditions, delete."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services import deletion_log
from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ChangedMeanwhileError, ConflictError
from app.storage.models.studies import SessionRow, Study, Trial
from app.study import assignment

from . import deleted_studies, orphaned_videos, repository
from .repository import StudyInfo


def pause(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """Admit no new sessions for a while; sessions under way continue.

    Raises NotFoundError, or ConflictError unless the study is open.
    """
    with app.database.write() as db:
        study = _lock_open_study(db, slug)
        if study.paused_at is None:
            study.paused_at = app.now()
            audit_log.note(db, study.paused_at, actor, "study paused", slug)
        return repository.read(db, slug)


def resume(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """End a pause. Raises NotFoundError, or ConflictError unless the study is open."""
    with app.database.write() as db:
        study = _lock_open_study(db, slug)
        if study.paused_at is not None:
            study.paused_at = None
            audit_log.note(db, app.now(), actor, "study resumed", slug)
        return repository.read(db, slug)


def switch_conditions(
    app: AppContext,
    slug: str,
    on: Sequence[str],
    actor: str = audit_log.COMMAND_LINE,
    *,
    base: Sequence[str] | None = None,
) -> StudyInfo:
    """Assign only these conditions to new sessions; sessions under way keep theirs.

    on: names of the conditions. base: the conditions that were off when the choice was made. Raises
    ChangedMeanwhileError if others are off by now, and ConflictError if no condition would be left,
    if a name is unknown, or if blocks would differ in length.
    """
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        plan = repository.read(db, slug).plan
        names = [condition.name for condition in plan.conditions]
        unknown = [name for name in on if name not in names]
        if unknown:
            known = ", ".join(names)
            raise ConflictError(f"expected conditions among {known}, got {unknown[0]!r}")
        off = [name for name in names if name not in on]
        now_off = list(study.conditions_off)
        if base is not None and sorted(base) != sorted(now_off) and off != now_off:
            raise ChangedMeanwhileError(
                "The conditions were switched since this page was opened. Off now:"
                f" {', '.join(now_off) or 'none'}. Off as you chose: {', '.join(off) or 'none'}."
                " Nothing was changed: choose again"
            )
        try:
            assignment.narrowed(plan, assignment.conditions_on(plan, off))
        except ValueError as error:
            raise ConflictError(str(error)) from None
        if off != list(study.conditions_off):
            study.conditions_off = off
            audit_log.note(db, app.now(), actor, "conditions switched", slug, off=off)
        db.flush()
        return repository.read(db, slug)


def delete(
    app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE, *, typed: str = ""
) -> None:
    """Delete a study with its participants, their ids and its videos; the audit log is kept.

    A closed study needs its slug as `typed`, since its data is lost; a draft does not. Raises
    ConflictError for an open study or a wrong `typed`, and StoreAwayError, before anything is
    deleted, if its videos cannot be deleted now.
    """
    app.recordings.require_reachable()
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        if study.status == repository.OPEN:
            raise ConflictError(f"expected a draft or a closed study, and {slug!r} is open")
        if study.status == repository.CLOSED and typed != slug:
            raise ConflictError(f"expected {slug!r} typed to delete it, got {typed!r}")
        status, digest = study.status, study.plans[-1].plan_hash
        seeds, files, number = _contents(db, study.id)
        # A draft has no live participants, so its deletion need not outlive a restore.
        if status == repository.CLOSED:
            key = deletion_log.study_key(slug, study.created_at)
            app.deletion_log.append(app.now(), deletion_log.STUDY, [key])
            deleted_studies.note(db, study, app.now())
        repository.delete_row(db, study)
        audit_log.note(
            db,
            app.now(),
            actor,
            "study deleted",
            slug,
            plan_hash=digest,
            status=status,
            sessions=number,
        )
        db.flush()
        left = orphaned_videos.unreferenced(app, db, files)
    app.proposer.purge(seeds)
    app.recordings.delete(left)
    app.database.scrub()


def _lock_open_study(db: Session, slug: str) -> Study:
    """Lock the study's row. Raises NotFoundError, or ConflictError unless the study is open."""
    study = repository.lock_study(db, slug)
    if study.status != repository.OPEN:
        raise ConflictError(f"expected an open study, and {slug!r} is {study.status}")
    return study


def _contents(db: Session, study_id: int) -> tuple[frozenset[int], set[str], int]:
    """The seeds of a study's trials, the names of its own videos, and its number of sessions."""
    seeds = db.scalars(
        select(Trial.seed)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(SessionRow.study_id == study_id)
    )
    number = len(db.scalars(select(SessionRow.id).where(SessionRow.study_id == study_id)).all())
    return frozenset(seeds), orphaned_videos.of_study(db, study_id), number
