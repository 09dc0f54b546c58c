"""What becomes of a study once it is there: paused, gone on with, narrowed, deleted."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.tables import SessionRow, Study, Trial
from app.study import assignment

from . import audit, deleted_studies, ledger, left_videos, studies
from .errors import ChangedMeanwhileError, ConflictError
from .studies import StudyInfo
from .studio import Studio


def pause(studio: Studio, slug: str, actor: str = audit.COMMAND_LINE) -> StudyInfo:
    """Let nobody in for a while; whoever is in it goes on. Raises ConflictError."""
    with studio.database.write() as session:
        study = _open(session, slug)
        if study.paused_at is None:
            study.paused_at = studio.now()
            audit.note(session, study.paused_at, actor, "study paused", slug)
        return studies.read(session, slug)


def resume(studio: Studio, slug: str, actor: str = audit.COMMAND_LINE) -> StudyInfo:
    """Let people in again. Raises ConflictError unless the study is open."""
    with studio.database.write() as session:
        study = _open(session, slug)
        if study.paused_at is not None:
            study.paused_at = None
            audit.note(session, studio.now(), actor, "study resumed", slug)
        return studies.read(session, slug)


def switch_conditions(
    studio: Studio,
    slug: str,
    on: Sequence[str],
    actor: str = audit.COMMAND_LINE,
    *,
    base: Sequence[str] | None = None,
) -> StudyInfo:
    """Give new sessions only these conditions; sessions under way keep theirs.

    base: those that were off when the choice was made. Raises ChangedMeanwhileError if others are
    off by now, and ConflictError if none would be left, if one is not the study's, or if blocks
    would come to differ in length.
    """
    with studio.database.write() as session:
        study = studies.to_change(session, slug)
        plan = studies.read(session, slug).plan
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
            audit.note(session, studio.now(), actor, "conditions switched", slug, off=off)
        session.flush()
        return studies.read(session, slug)


def delete(studio: Studio, slug: str, actor: str = audit.COMMAND_LINE, *, typed: str = "") -> None:
    """Delete a study with its people, their identities and its videos; the audit trail remains.

    A draft goes at once. A closed study goes if `typed` is its slug: its data is gone for good.
    Raises ConflictError for an open study, or where something else was typed, and StoreAwayError,
    before anything is deleted, while its videos cannot be.
    """
    studio.recordings.require_reachable()
    with studio.database.write() as session:
        study = studies.to_change(session, slug)
        if study.status == studies.OPEN:
            raise ConflictError(f"expected a draft or a closed study, and {slug!r} is open")
        if study.status == studies.CLOSED and typed != slug:
            raise ConflictError(f"expected {slug!r} typed to delete it, got {typed!r}")
        status, digest = study.status, study.plans[-1].plan_hash
        seeds, files, number = _held(session, study.id)
        # With its people: a draft has none, and is made and thrown away at will.
        if status == studies.CLOSED:
            key = ledger.study_key(slug, study.created_at)
            studio.ledger.note(studio.now(), ledger.STUDY, [key])
            deleted_studies.note(session, study, studio.now())
        studies.delete_row(session, study)
        audit.note(
            session,
            studio.now(),
            actor,
            "study deleted",
            slug,
            plan_hash=digest,
            status=status,
            sessions=number,
        )
        session.flush()
        left = left_videos.in_no_study(studio, session, files)
    studio.proposer.purge(seeds)
    studio.recordings.throw_away(left)
    studio.database.scrub()


def _open(session: Session, slug: str) -> Study:
    study = studies.to_change(session, slug)
    if study.status != studies.OPEN:
        raise ConflictError(f"expected an open study, and {slug!r} is {study.status}")
    return study


def _held(session: Session, study_id: int) -> tuple[frozenset[int], set[str], int]:
    """The seeds of a study's trials, the files of its own videos, and how many sessions it has."""
    seeds = session.scalars(
        select(Trial.seed)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(SessionRow.study_id == study_id)
    )
    number = len(
        session.scalars(select(SessionRow.id).where(SessionRow.study_id == study_id)).all()
    )
    return frozenset(seeds), left_videos.of_study(session, study_id), number
