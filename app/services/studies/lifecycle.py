"""What becomes of a study once it is there: paused, gone on with, narrowed, deleted."""

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
    """Let nobody in for a while; whoever is in it goes on. Raises ConflictError."""
    with app.database.write() as db:
        study = _lock_open_study(db, slug)
        if study.paused_at is None:
            study.paused_at = app.now()
            audit_log.note(db, study.paused_at, actor, "study paused", slug)
        return repository.read(db, slug)


def resume(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """Let people in again. Raises ConflictError unless the study is open."""
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
    """Give new sessions only these conditions; sessions under way keep theirs.

    base: those that were off when the choice was made. Raises ChangedMeanwhileError if others are
    off by now, and ConflictError if none would be left, if one is not the study's, or if blocks
    would come to differ in length.
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
    """Delete a study with its people, their identities and its videos; the audit trail remains.

    A draft goes at once. A closed study goes if `typed` is its slug: its data is gone for good.
    Raises ConflictError for an open study, or where something else was typed, and StoreAwayError,
    before anything is deleted, while its videos cannot be.
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
        # With its people: a draft has none, and is made and thrown away at will.
        if status == repository.CLOSED:
            key = deletion_log.study_key(slug, study.created_at)
            app.deletion_log.note(app.now(), deletion_log.STUDY, [key])
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
    study = repository.lock_study(db, slug)
    if study.status != repository.OPEN:
        raise ConflictError(f"expected an open study, and {slug!r} is {study.status}")
    return study


def _contents(db: Session, study_id: int) -> tuple[frozenset[int], set[str], int]:
    """The seeds of a study's trials, the files of its own videos, and how many sessions it has."""
    seeds = db.scalars(
        select(Trial.seed)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(SessionRow.study_id == study_id)
    )
    number = len(db.scalars(select(SessionRow.id).where(SessionRow.study_id == study_id)).all())
    return frozenset(seeds), orphaned_videos.of_study(db, study_id), number
