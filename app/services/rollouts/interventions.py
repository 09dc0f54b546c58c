"""What experimenters do to rollouts: cancel, retry. Each is noted in the audit log.

Withdrawing one changes what sessions have learnt: `sessions.box_withdrawal`.
"""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError
from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Study
from app.study.typed_text import typed_length

from . import outcomes
from .reports import LONGEST_REASON


def cancel(
    app: AppContext, slug: str, public_id: str, reason: str, actor: str = audit_log.COMMAND_LINE
) -> None:
    """Cancel an outstanding rollout; its machine is told at its next heartbeat.

    Sessions that wait for it are given another pair. Raises NotFoundError, or ConflictError if the
    rollout has ended.
    """
    with app.database.write() as db:
        rollout = _locked(db, slug, public_id)
        outcomes.cancel(rollout, checked_reason(reason), app.now())
        _note(app, db, actor, "rollout cancelled", slug, rollout=public_id, reason=reason)


def retry(app: AppContext, slug: str, public_id: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """Ask again for a rollout that failed or was cancelled.

    Raises NotFoundError or ConflictError.
    """
    with app.database.write() as db:
        outcomes.retry(db, _locked(db, slug, public_id), actor, app.now())
        _note(app, db, actor, "rollout retried", slug, rollout=public_id)


def found(db: Session, slug: str, public_id: str) -> Rollout:
    """The rollout of this study, not locked. Raises NotFoundError."""
    rollout = db.scalar(
        select(Rollout).where(Rollout.study_id == _study(db, slug), Rollout.public_id == public_id)
    )
    if rollout is None:
        raise NotFoundError("there is no such rollout in this study")
    return rollout


def machine_named(db: Session, slug: str, name: str) -> Machine:
    """The machine of this study with this name. Raises NotFoundError."""
    machine = db.scalar(
        select(Machine)
        .join(Study, Machine.study_id == Study.id)
        .where(Study.slug == slug, Machine.name == name)
    )
    if machine is None:
        raise NotFoundError(f"there is no machine {name!r} in {slug!r}")
    return machine


def checked_reason(said: str) -> str:
    """A reason without superfluous spaces. Raises ConflictError for an empty or a long one."""
    said = " ".join(said.split())
    length = typed_length(said)
    if not 0 < length <= LONGEST_REASON:
        raise ConflictError(
            f"expected a reason of 1 to {LONGEST_REASON:,} characters, got {length:,}"
        )
    return said


def _locked(db: Session, slug: str, public_id: str) -> Rollout:
    return outcomes.locked(db, _study(db, slug), public_id)


def _study(db: Session, slug: str) -> int:
    study_id = db.scalar(select(Study.id).where(Study.slug == slug))
    if study_id is None:
        raise NotFoundError(f"there is no study named {slug!r}")
    return study_id


def _note(
    app: AppContext, db: Session, actor: str, action: str, slug: str, **details: object
) -> None:
    audit_log.note(db, app.now(), actor, action, slug, **details)
