"""Self-service for one's own account: the password, the sign-ins and the API tokens."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import delete, select

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, ForbiddenError, NotFoundError
from app.storage.models.accounts import Account, ApiToken, SignIn
from app.study.typed_text import typed_length

from . import accounts, audit_log, credential_revocation, login_rate_limit, password_hash_limit
from .accounts import API_TOKEN_LASTS, Principal, Scope

LONGEST_LABEL = 100
MOST_DAYS = API_TOKEN_LASTS.days


@dataclass(frozen=True)
class SignInLine:
    """One sign-in of the caller. is_this: whether the request came with it."""

    id: int
    created_at: datetime
    expires_at: datetime
    is_this: bool


@dataclass(frozen=True)
class TokenLine:
    """One API token of the caller, without its secret."""

    id: int
    label: str
    scope: str
    created_at: datetime
    expires_at: datetime
    is_expired: bool


def change_password(app: AppContext, caller: Principal, old: str, new: str) -> None:
    """Change the caller's password, and revoke all their credentials but the present sign-in.

    Raises ForbiddenError if the old password is wrong or was changed meanwhile, ConflictError if
    the new one is too short, TooManyTriesError, or TooManyPasswordsError.
    """
    # A signed-in browser is a known device: attempts by strangers do not delay it.
    came_from = login_rate_limit.CameFrom(device=f"account {caller.account_id}")
    with password_hash_limit.hash_slot(app, came_from):
        with app.database.write() as db:
            login_rate_limit.record_attempt(db, app.now(), caller.email, came_from)
            account = db.get_one(Account, caller.account_id)
        if not accounts.is_password_of(account, old):
            raise ForbiddenError("That is not the present password.")
        hashed = accounts.hashed_password(new)
    with app.database.write() as db:
        login_rate_limit.reset(db, caller.email, came_from)
        now = accounts.lock(db, caller.account_id)
        if now.password_hash != account.password_hash or now.disabled_at is not None:
            # Reset meanwhile: whoever knows the old password must not be able to undo that.
            raise ForbiddenError("The password was changed meanwhile. Sign in again.")
        now.password_hash = hashed
        ended = credential_revocation.revoke_all(db, now, except_sign_in=caller.sign_in_id)
        audit_log.note(db, app.now(), caller.email, "password changed", **ended.as_details())


def sign_ins(app: AppContext, caller: Principal) -> list[SignInLine]:
    """The caller's sign-ins in force, the newest first."""
    statement = (
        select(SignIn)
        .where(SignIn.account_id == caller.account_id, SignIn.expires_at > app.now())
        .order_by(SignIn.id.desc())
    )
    with app.database.read() as db:
        return [
            SignInLine(row.id, row.created_at, row.expires_at, row.id == caller.sign_in_id)
            for row in db.scalars(statement)
        ]


def end_sign_ins(app: AppContext, caller: Principal, sign_in_id: int | None = None) -> None:
    """Delete one of the caller's sign-ins, or (None) all but the present one.

    Raises NotFoundError if it is not the caller's.
    """
    chosen = (
        SignIn.id == sign_in_id if sign_in_id is not None else SignIn.id != (caller.sign_in_id or 0)
    )
    with app.database.write() as db:
        ended = db.scalars(
            delete(SignIn)
            .where(SignIn.account_id == caller.account_id, chosen)
            .returning(SignIn.id)
        ).all()
        if sign_in_id is not None and not ended:
            raise NotFoundError("expected a sign-in of one's own, and it is not there any more")
        audit_log.note(db, app.now(), caller.email, "sign-ins ended", number=len(ended))


def api_tokens(app: AppContext, caller: Principal) -> list[TokenLine]:
    """The caller's API tokens, the newest first."""
    statement = (
        select(ApiToken)
        .where(ApiToken.account_id == caller.account_id)
        .order_by(ApiToken.id.desc())
    )
    with app.database.read() as db:
        return [
            TokenLine(
                row.id,
                row.label,
                row.scope,
                row.created_at,
                row.expires_at,
                app.now() >= row.expires_at,
            )
            for row in db.scalars(statement)
        ]


def make_api_token(app: AppContext, caller: Principal, label: str, scope: Scope, days: int) -> str:
    """Create an API token for the caller and return it; only its hash is stored.

    days: its lifetime. Raises ConflictError if the label or the lifetime is out of range.
    """
    label = label.strip()
    length = typed_length(label)
    if not 1 <= length <= LONGEST_LABEL:
        raise ConflictError(f"expected a label of 1 to {LONGEST_LABEL} characters, got {length}")
    if not 1 <= days <= MOST_DAYS:
        raise ConflictError(f"expected 1 to {MOST_DAYS} days, got {days}")
    lasts = timedelta(days=days)
    return accounts.create_api_token(app, caller, label, scope, lasts, actor=caller.email)


def revoke_api_token(app: AppContext, caller: Principal, token_id: int) -> None:
    """Delete one of the caller's API tokens. Raises NotFoundError if it is not the caller's."""
    with app.database.write() as db:
        row = db.get(ApiToken, token_id)
        if row is None or row.account_id != caller.account_id:
            raise NotFoundError("expected an API token of one's own, and it is not there any more")
        db.delete(row)
        audit_log.note(db, app.now(), caller.email, "API token revoked", label=row.label)
