"""Single-use links for choosing a password, for a new account or a password reset.

A link holds 256 random bits, so guessing one is hopeless and attempts need no limit. Only its hash
is stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import CursorResult, delete, select, update

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, InvitationError, NotFoundError
from app.services.runtime.ids import new_secret, secret_hash
from app.storage.models.accounts import Invitation

from . import accounts, audit_log, credential_revocation, password_hash_limit
from .accounts import Role
from .login_rate_limit import CameFrom

LASTS = timedelta(days=7)

#: How long a used or expired link is kept, so that its page can say why it no longer works.
REMEMBERED = timedelta(days=90)


@dataclass(frozen=True)
class Invited:
    """A link's recipient.

    role: that of the new account; None for a reset of an existing account.
    """

    id: int
    email: str
    role: Role | None
    created_at: datetime
    expires_at: datetime


def invite(app: AppContext, email: str, role: Role, actor: str) -> str:
    """Create a link for a new account and return its path.

    Raises ConflictError if the address has one.
    """
    return _make(app, accounts.address(email), role, actor)


def reset(app: AppContext, email: str, actor: str) -> str:
    """Create a password-reset link and return its path.

    Raises NotFoundError if no account has the address, and ConflictError if the account is
    disabled.
    """
    return _make(app, accounts.normal(email), None, actor)


def find(app: AppContext, token: str) -> Invited:
    """The recipient of the link with this token.

    Raises InvitationError if the link cannot be used.
    """
    statement = select(Invitation).where(Invitation.token_hash == secret_hash(token))
    with app.database.read() as db:
        row = db.scalar(statement)
    if row is None:
        raise InvitationError("Nobody was given this link. Perhaps it was not copied whole.")
    if row.used_at is not None:
        raise InvitationError("This link has been used: the password is chosen. You can sign in.")
    if app.now() >= row.expires_at:
        raise InvitationError(
            "This link was good for 7 days. Ask the person who sent it to you for another one."
        )
    return _invited(row)


def accept(app: AppContext, token: str, password: str) -> str:
    """Set the password of a link's recipient, creating a new account first; return the address.

    Raises InvitationError if the link cannot be used or was just used; ConflictError if the
    password is too short; TooManyPasswordsError.
    """
    invited = find(app, token)
    # Reached with a valid link only, so the queue for known devices is not open to strangers.
    with password_hash_limit.hash_slot(app, CameFrom(device=f"invitation {invited.id}")):
        hashed = accounts.hashed_password(password)
    with app.database.write() as db:
        now = app.now()
        used = db.execute(
            update(Invitation)
            .where(Invitation.id == invited.id, Invitation.used_at.is_(None))
            .values(used_at=now)
        )
        assert isinstance(used, CursorResult)
        if used.rowcount != 1:
            raise InvitationError("This link has just been used. You can sign in.")
        if invited.role is not None:
            accounts.add(db, now, invited.email, hashed, invited.role)
            made = {"account": invited.email, "role": invited.role.value}
            audit_log.note(db, now, invited.email, "account made", **made)
        else:
            account = accounts.require(db, invited.email)
            if account.disabled_at is not None:
                raise InvitationError("This account is disabled. Ask an admin.")
            account.password_hash = hashed
            ended = credential_revocation.revoke_all(db, account).as_details()
            details: dict[str, Any] = {"account": invited.email, **ended}
            audit_log.note(db, now, invited.email, "password reset", **details)
    return invited.email


def outstanding(app: AppContext) -> list[Invited]:
    """Links that can still be used, the newest first."""
    statement = (
        select(Invitation)
        .where(Invitation.used_at.is_(None), Invitation.expires_at > app.now())
        .order_by(Invitation.id.desc())
    )
    with app.database.read() as db:
        return [_invited(row) for row in db.scalars(statement)]


def revoke(app: AppContext, invitation_id: int, actor: str) -> None:
    """Delete an unused link. Raises NotFoundError if it was used or does not exist."""
    with app.database.write() as db:
        row = db.get(Invitation, invitation_id)
        if row is None or row.used_at is not None:
            raise NotFoundError("expected a link that can still be used, and it is gone")
        db.delete(row)
        audit_log.note(db, app.now(), actor, "invitation taken back", account=row.email)


def _make(app: AppContext, email: str, role: Role | None, actor: str) -> str:
    token = new_secret()
    with app.database.write() as db:
        now = app.now()
        account = accounts.by_address(db, email)
        if role is None:
            account = accounts.require(db, email)
            if account.disabled_at is not None:
                raise ConflictError(f"expected an account that is not disabled, and {email!r} is")
        elif account is not None:
            raise ConflictError(f"expected a new address, and {email!r} has an account")
        # Only the newest link works: an earlier one may have gone to the wrong person.
        db.execute(
            delete(Invitation).where(Invitation.email == email, Invitation.used_at.is_(None))
        )
        db.execute(delete(Invitation).where(Invitation.expires_at < now - REMEMBERED))
        db.add(
            Invitation(
                token_hash=secret_hash(token),
                email=email,
                role=role and role.value,
                created_at=now,
                expires_at=now + LASTS,
            )
        )
        if role is None:
            audit_log.note(db, now, actor, "reset link made", account=email)
        else:
            audit_log.note(db, now, actor, "account invited", account=email, role=role.value)
    return f"/invitations/{token}"


def _invited(row: Invitation) -> Invited:
    role = None if row.role is None else Role(row.role)
    return Invited(row.id, row.email, role, row.created_at, row.expires_at)
