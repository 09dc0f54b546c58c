"""What experimenters do to rollouts: cancel, retry, withdraw. Each is noted in the audit log."""

from __future__ import annotations

from datetime import datetime

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
        outcomes.cancel(rollout, _reason(reason), app.now())
        _note(app, db, actor, "rollout cancelled", slug, rollout=public_id, reason=reason)


def retry(app: AppContext, slug: str, public_id: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """Ask again for a rollout that failed or was cancelled.

    Raises NotFoundError or ConflictError.
    """
    with app.database.write() as db:
        outcomes.retry(db, _locked(db, slug, public_id), actor, app.now())
        _note(app, db, actor, "rollout retried", slug, rollout=public_id)


def withdraw(
    app: AppContext, slug: str, public_id: str, reason: str, actor: str = audit_log.COMMAND_LINE
) -> int:
    """Withdraw a recorded rollout; return the number of responses that leave the model.

    Raises NotFoundError, or ConflictError if the rollout is not recorded or no reason is given.
    """
    with app.database.write() as db:
        rollout = _locked(db, slug, public_id)
        number = outcomes.withdraw(db, [rollout], _reason(reason), app.now())
        _note(
            app,
            db,
            actor,
            "rollout withdrawn",
            slug,
            rollout=public_id,
            reason=reason,
            responses=number,
        )
        return number


def withdraw_machine(
    app: AppContext,
    slug: str,
    name: str,
    since: datetime,
    reason: str,
    actor: str = audit_log.COMMAND_LINE,
) -> tuple[int, int]:
    """Withdraw what a machine has recorded since a time, as when it was found to be miscalibrated.

    Returns the numbers of rollouts and of responses that leave the model. Raises NotFoundError, or
    ConflictError if no reason is given.
    """
    with app.database.write() as db:
        machine = db.scalar(
            select(Machine)
            .join(Study, Machine.study_id == Study.id)
            .where(Study.slug == slug, Machine.name == name)
        )
        if machine is None:
            raise NotFoundError(f"there is no machine {name!r} in {slug!r}")
        rollouts = outcomes.recorded_by(db, machine.id, since)
        number = outcomes.withdraw(db, rollouts, _reason(reason), app.now())
        _note(
            app,
            db,
            actor,
            "machine's rollouts withdrawn",
            slug,
            machine=name,
            since=since.isoformat(),
            reason=reason,
            rollouts=len(rollouts),
            responses=number,
        )
        return len(rollouts), number


def _locked(db: Session, slug: str, public_id: str) -> Rollout:
    study_id = db.scalar(select(Study.id).where(Study.slug == slug))
    if study_id is None:
        raise NotFoundError(f"there is no study named {slug!r}")
    return outcomes.locked(db, study_id, public_id)


def _reason(said: str) -> str:
    said = " ".join(said.split())
    length = typed_length(said)
    if not 0 < length <= LONGEST_REASON:
        raise ConflictError(
            f"expected a reason of 1 to {LONGEST_REASON:,} characters, got {length:,}"
        )
    return said


def _note(
    app: AppContext, db: Session, actor: str, action: str, slug: str, **details: object
) -> None:
    audit_log.note(db, app.now(), actor, action, slug, **details)
