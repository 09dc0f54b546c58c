"""Account administration for admins: list accounts, disable and enable them, change their roles."""

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
    """All accounts, sorted by address."""
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
    """Disable an account, and revoke its sign-ins, API tokens and unused links.

    Raises NotFoundError, or ConflictError for the last admin.
    """
    with app.database.write() as db:
        account = accounts.require(db, email)
        if account.disabled_at is not None:
            return
        _require_another_admin(db, account)
        account.disabled_at = app.now()
        ended = credential_revocation.revoke_all(db, account).as_details()
        audit_log.note(db, app.now(), actor, "account disabled", account=account.email, **ended)


def enable(app: AppContext, email: str, actor: str) -> None:
    """Enable a disabled account. What was revoked stays revoked. Raises NotFoundError."""
    with app.database.write() as db:
        account = accounts.require(db, email)
        if account.disabled_at is None:
            return
        account.disabled_at = None
        # Earlier versions left API tokens in place when an account was disabled.
        credential_revocation.revoke_all(db, account)
        audit_log.note(db, app.now(), actor, "account enabled", account=account.email)


def change_role(app: AppContext, email: str, role: Role, actor: str) -> None:
    """Change the role of an account, and revoke its sign-ins, API tokens and unused links.

    They were issued under the old role, and a token must not gain an admin's rights by itself.
    Raises NotFoundError, or ConflictError for the last admin.
    """
    with app.database.write() as db:
        account = accounts.require(db, email)
        before = account.role
        if before == role:
            return
        _require_another_admin(db, account)
        account.role = role.value
        ended = credential_revocation.revoke_all(db, account).as_details()
        details: dict[str, Any] = {
            "account": account.email,
            "before": before,
            "after": role.value,
            **ended,
        }
        audit_log.note(db, app.now(), actor, "role changed", **details)


def _require_another_admin(db: Session, account: Account) -> None:
    """Raise ConflictError if this is the only admin, since admins alone can assign roles."""
    # Locked: two admins demoting each other at the same time would leave none.
    admins = db.scalars(
        select(Account)
        .where(Account.role == Role.ADMIN.value, Account.disabled_at.is_(None))
        .order_by(Account.id)
        .with_for_update()
    ).all()
    if [admin.id for admin in admins] == [account.id]:
        raise ConflictError(f"expected another admin, and {account.email} is the last one")
