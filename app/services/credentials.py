"""What people change about their own account: their password, their sign-ins, their API tokens."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import delete, select

from app.storage.accounts import Account, ApiToken, SignIn

from . import accounts, audit, hashing, tries, ways_in
from .accounts import API_TOKEN_LASTS, Experimenter, Scope
from .errors import ConflictError, ForbiddenError, NotFoundError
from .studio import Studio

LONGEST_LABEL = 100
MOST_DAYS = API_TOKEN_LASTS.days


@dataclass(frozen=True)
class SignInLine:
    """One browser in which somebody is signed in."""

    id: int
    created_at: datetime
    expires_at: datetime
    is_this: bool


@dataclass(frozen=True)
class TokenLine:
    """One API token, without what was shown once."""

    id: int
    label: str
    scope: str
    created_at: datetime
    expires_at: datetime
    is_expired: bool


def change_password(studio: Studio, caller: Experimenter, old: str, new: str) -> None:
    """Give one's own account another password.

    The sign-in that asks stays; every other one ends, with all API tokens and open links. Raises
    ForbiddenError if the old one is wrong, or if the password was changed meanwhile,
    TooManyTriesError, TooManyPasswordsError, or ConflictError if the new one is too short.
    """
    # A browser that is signed in is known, and what strangers try does not keep it waiting.
    came_from = tries.CameFrom(device=f"account {caller.account_id}")
    with hashing.one_at_a_time(studio, came_from):
        with studio.database.write() as session:
            tries.spend(session, studio.now(), caller.email, came_from)
            account = session.get_one(Account, caller.account_id)
        if not accounts.is_password_of(account, old):
            raise ForbiddenError("That is not the present password.")
        hashed = accounts.hashed_password(new)
    with studio.database.write() as session:
        tries.forgive(session, caller.email, came_from)
        now = accounts.held(session, caller.account_id)
        if now.password_hash != account.password_hash or now.disabled_at is not None:
            # A reset came in between: it must not be undone by someone who knew the old password.
            raise ForbiddenError("The password was changed meanwhile. Sign in again.")
        now.password_hash = hashed
        ended = ways_in.end_all(session, now, but_sign_in=caller.sign_in_id)
        audit.note(session, studio.now(), caller.email, "password changed", **ended.noted())


def sign_ins(studio: Studio, caller: Experimenter) -> list[SignInLine]:
    """Where the caller is signed in, the newest first."""
    statement = (
        select(SignIn)
        .where(SignIn.account_id == caller.account_id, SignIn.expires_at > studio.now())
        .order_by(SignIn.id.desc())
    )
    with studio.database.read() as session:
        return [
            SignInLine(row.id, row.created_at, row.expires_at, row.id == caller.sign_in_id)
            for row in session.scalars(statement)
        ]


def end_sign_ins(studio: Studio, caller: Experimenter, sign_in_id: int | None = None) -> None:
    """End one of the caller's sign-ins, or (None) all but the one that asks.

    Raises NotFoundError if it is not the caller's.
    """
    chosen = (
        SignIn.id == sign_in_id if sign_in_id is not None else SignIn.id != (caller.sign_in_id or 0)
    )
    with studio.database.write() as session:
        ended = session.scalars(
            delete(SignIn)
            .where(SignIn.account_id == caller.account_id, chosen)
            .returning(SignIn.id)
        ).all()
        if sign_in_id is not None and not ended:
            raise NotFoundError("expected a sign-in of one's own, and it is not there any more")
        audit.note(session, studio.now(), caller.email, "sign-ins ended", number=len(ended))


def api_tokens(studio: Studio, caller: Experimenter) -> list[TokenLine]:
    """The caller's API tokens, the newest first."""
    statement = (
        select(ApiToken)
        .where(ApiToken.account_id == caller.account_id)
        .order_by(ApiToken.id.desc())
    )
    with studio.database.read() as session:
        return [
            TokenLine(
                row.id,
                row.label,
                row.scope,
                row.created_at,
                row.expires_at,
                studio.now() >= row.expires_at,
            )
            for row in session.scalars(statement)
        ]


def make_api_token(
    studio: Studio, caller: Experimenter, label: str, scope: Scope, days: int
) -> str:
    """A token for the caller's programs, shown this once. Raises ConflictError."""
    label = label.strip()
    if not 1 <= len(label) <= LONGEST_LABEL:
        raise ConflictError(
            f"expected a label of 1 to {LONGEST_LABEL} characters, got {len(label)}"
        )
    if not 1 <= days <= MOST_DAYS:
        raise ConflictError(f"expected 1 to {MOST_DAYS} days, got {days}")
    lasts = timedelta(days=days)
    return accounts.create_api_token(studio, caller, label, scope, lasts, actor=caller.email)


def revoke_api_token(studio: Studio, caller: Experimenter, token_id: int) -> None:
    """Make one of the caller's API tokens worth nothing. Raises NotFoundError."""
    with studio.database.write() as session:
        row = session.get(ApiToken, token_id)
        if row is None or row.account_id != caller.account_id:
            raise NotFoundError("expected an API token of one's own, and it is not there any more")
        session.delete(row)
        audit.note(session, studio.now(), caller.email, "API token revoked", label=row.label)
