"""The members of a study: its owner, and the experimenters it is shared with."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Select, select

from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError
from app.storage.models.accounts import Account, StudyAccess

from . import repository


@dataclass(frozen=True)
class Member:
    """An account with access to a study, as its owner or by sharing."""

    account_id: int
    email: str
    is_owner: bool
    is_disabled: bool
    since: datetime


def members(app: AppContext, slug: str) -> list[Member]:
    """The members of a study: the owner first, then the others by address."""
    with app.database.read() as db:
        study = repository.read(db, slug)
        rows = db.execute(
            select(StudyAccess, Account)
            .join(Account, StudyAccess.account_id == Account.id)
            .where(StudyAccess.study_id == study.id)
        ).all()
    found = [
        Member(
            account.id,
            account.email,
            membership.access == repository.OWNER,
            account.disabled_at is not None,
            membership.created_at,
        )
        for membership, account in rows
    ]
    return sorted(found, key=lambda membership: (not membership.is_owner, membership.email))


def share(app: AppContext, slug: str, email: str, actor: str) -> None:
    """Share a study with an experimenter. Sharing it again changes nothing.

    Raises NotFoundError if no account has the address, and ConflictError for a reviewer.
    """
    with app.database.write() as db:
        # Locked, so that parallel calls do not insert the membership twice.
        study = repository.lock_study(db, slug)
        account = accounts.require(db, email)
        if account.role == Role.REVIEWER:
            raise ConflictError(
                f"expected an experimenter: {account.email} is a reviewer, and reads every design"
            )
        if db.scalar(_membership(study.id, account.id)) is not None:
            return
        db.add(
            StudyAccess(
                study_id=study.id,
                account_id=account.id,
                access=repository.SHARED,
                created_at=app.now(),
            )
        )
        audit_log.note(db, app.now(), actor, "study shared", slug, account=account.email)


def stop_sharing(app: AppContext, slug: str, account_id: int, actor: str) -> None:
    """Remove a member that the study is shared with. Raises NotFoundError if there is none."""
    with app.database.write() as db:
        study = repository.read(db, slug)
        membership = db.scalar(_membership(study.id, account_id))
        if membership is None or membership.access != repository.SHARED:
            raise NotFoundError("expected somebody whom the study is shared with")
        account = db.get_one(Account, account_id)
        db.delete(membership)
        audit_log.note(db, app.now(), actor, "sharing ended", slug, account=account.email)


def _membership(study_id: int, account_id: int) -> Select[StudyAccess]:
    return select(StudyAccess).where(
        StudyAccess.study_id == study_id, StudyAccess.account_id == account_id
    )
