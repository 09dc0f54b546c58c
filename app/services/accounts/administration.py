"""What admins do with accounts: see them all, disable and enable them, give them another role."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.storage.models.accounts import Account, SignIn

from . import accounts, audit_log, credential_revocation
from .accounts import Role


@dataclass(frozen=True)
class AccountLine:
    """One account in the list."""

    email: str
    role: Role
    created_at: datetime
    disabled_at: datetime | None
    last_sign_in_at: datetime | None


def all_accounts(app: AppContext) -> list[AccountLine]:
    """Every account, by address."""
    last = (
        select(SignIn.account_id, func.max(SignIn.created_at).label("at"))
        .group_by(SignIn.account_id)
        .subquery()
    )
    statement = (
        select(Account, last.c.at)
        .outerjoin(last, last.c.account_id == Account.id)
        .order_by(Account.email)
    )
    with app.database.read() as db:
        return [
            AccountLine(row.email, Role(row.role), row.created_at, row.disabled_at, at)
            for row, at in db.execute(statement)
        ]


def disable(app: AppContext, email: str, actor: str) -> None:
    """Let nobody in with this account any more: its sign-ins, API tokens and open links end.

    Raises ConflictError for the last admin.
    """
    with app.database.write() as db:
        account = accounts.require(db, email)
        if account.disabled_at is not None:
            return
        _require_another_admin(db, account)
        account.disabled_at = app.now()
        ended = credential_revocation.end_all(db, account).noted()
        audit_log.note(db, app.now(), actor, "account disabled", account=account.email, **ended)


def enable(app: AppContext, email: str, actor: str) -> None:
    """Let the owner of a disabled account sign in again; nothing that ended is revived."""
    with app.database.write() as db:
        account = accounts.require(db, email)
        if account.disabled_at is None:
            return
        account.disabled_at = None
        # Earlier versions left API tokens in place when an account was disabled.
        credential_revocation.end_all(db, account)
        audit_log.note(db, app.now(), actor, "account enabled", account=account.email)


def change_role(app: AppContext, email: str, role: Role, actor: str) -> None:
    """Give an account another role; its sign-ins, API tokens and open links end.

    They were given for what the account was, and a token must not become an admin's by itself.
    Raises ConflictError for the last admin.
    """
    with app.database.write() as db:
        account = accounts.require(db, email)
        before = account.role
        if before == role:
            return
        _require_another_admin(db, account)
        account.role = role.value
        ended = credential_revocation.end_all(db, account).noted()
        told: dict[str, Any] = {
            "account": account.email,
            "before": before,
            "after": role.value,
            **ended,
        }
        audit_log.note(db, app.now(), actor, "role changed", **told)


def _require_another_admin(db: Session, account: Account) -> None:
    """Raises ConflictError if nobody could give accounts roles any more without this one."""
    # Locked: two admins who demote each other at once would leave none.
    admins = db.scalars(
        select(Account)
        .where(Account.role == Role.ADMIN.value, Account.disabled_at.is_(None))
        .order_by(Account.id)
        .with_for_update()
    ).all()
    if [admin.id for admin in admins] == [account.id]:
        raise ConflictError(f"expected another admin, and {account.email} is the last one")
