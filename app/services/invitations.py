"""Links with which somebody chooses a password, once: for a new account, or for a lost password.

A link holds 256 random bits: nobody finds one by trying, so no limit on tries is needed. Only its
hash is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import CursorResult, delete, select, update

from app.storage.accounts import Invitation

from . import accounts, audit, hashing, ways_in
from .accounts import Role
from .errors import ConflictError, InvitationError, NotFoundError
from .studio import Studio
from .tokens import new_secret, secret_hash
from .tries import CameFrom

LASTS = timedelta(days=7)

#: A used or expired link is remembered for so long, to say kindly what became of it.
REMEMBERED = timedelta(days=90)


@dataclass(frozen=True)
class Invited:
    """Who may choose a password. `role`: of the new account; None if the account is there."""

    id: int
    email: str
    role: Role | None
    created_at: datetime
    expires_at: datetime


def invite(studio: Studio, email: str, role: Role, actor: str) -> str:
    """The path of a link that makes an account. Raises ConflictError if the address has one."""
    return _make(studio, accounts.address(email), role, actor)


def reset(studio: Studio, email: str, actor: str) -> str:
    """The path of a link that gives an account another password. Raises NotFoundError."""
    return _make(studio, accounts.normal(email), None, actor)


def find(studio: Studio, token: str) -> Invited:
    """Whom the link of this token is for. Raises InvitationError if it cannot be used."""
    statement = select(Invitation).where(Invitation.token_hash == secret_hash(token))
    with studio.database.read() as session:
        row = session.scalar(statement)
    if row is None:
        raise InvitationError("Nobody was given this link. Perhaps it was not copied whole.")
    if row.used_at is not None:
        raise InvitationError("This link has been used: the password is chosen. You can sign in.")
    if studio.now() >= row.expires_at:
        raise InvitationError(
            "This link was good for 7 days. Ask the person who sent it to you for another one."
        )
    return _invited(row)


def accept(studio: Studio, token: str, password: str) -> str:
    """Choose a password; the address that can sign in with it now.

    Raises InvitationError if the link cannot be used, or was used a moment ago; ConflictError if
    the password is too short; TooManyPasswordsError.
    """
    invited = find(studio, token)
    # Only a link that is good comes as far as this.
    with hashing.one_at_a_time(studio, CameFrom(device=f"invitation {invited.id}")):
        hashed = accounts.hashed_password(password)
    with studio.database.write() as session:
        now = studio.now()
        used = session.execute(
            update(Invitation)
            .where(Invitation.id == invited.id, Invitation.used_at.is_(None))
            .values(used_at=now)
        )
        assert isinstance(used, CursorResult)
        if used.rowcount != 1:
            raise InvitationError("This link has just been used. You can sign in.")
        if invited.role is not None:
            accounts.add(session, now, invited.email, hashed, invited.role)
            made = {"account": invited.email, "role": invited.role.value}
            audit.note(session, now, invited.email, "account made", **made)
        else:
            account = accounts.require(session, invited.email)
            if account.disabled_at is not None:
                raise InvitationError("This account is disabled. Ask an admin.")
            account.password_hash = hashed
            ended = ways_in.end_all(session, account).noted()
            told: dict[str, Any] = {"account": invited.email, **ended}
            audit.note(session, now, invited.email, "password reset", **told)
    return invited.email


def outstanding(studio: Studio) -> list[Invited]:
    """Links that can still be used, the newest first."""
    statement = (
        select(Invitation)
        .where(Invitation.used_at.is_(None), Invitation.expires_at > studio.now())
        .order_by(Invitation.id.desc())
    )
    with studio.database.read() as session:
        return [_invited(row) for row in session.scalars(statement)]


def take_back(studio: Studio, invitation_id: int, actor: str) -> None:
    """Make a link worth nothing. Raises NotFoundError if it was used or is not there."""
    with studio.database.write() as session:
        row = session.get(Invitation, invitation_id)
        if row is None or row.used_at is not None:
            raise NotFoundError("expected a link that can still be used, and it is gone")
        session.delete(row)
        audit.note(session, studio.now(), actor, "invitation taken back", account=row.email)


def _make(studio: Studio, email: str, role: Role | None, actor: str) -> str:
    token = new_secret()
    with studio.database.write() as session:
        now = studio.now()
        account = accounts.by_address(session, email)
        if role is None:
            account = accounts.require(session, email)
            if account.disabled_at is not None:
                raise ConflictError(f"expected an account that is not disabled, and {email!r} is")
        elif account is not None:
            raise ConflictError(f"expected a new address, and {email!r} has an account")
        # The newest link counts: an earlier one may have gone to the wrong person.
        session.execute(
            delete(Invitation).where(Invitation.email == email, Invitation.used_at.is_(None))
        )
        session.execute(delete(Invitation).where(Invitation.expires_at < now - REMEMBERED))
        session.add(
            Invitation(
                token_hash=secret_hash(token),
                email=email,
                role=role and role.value,
                created_at=now,
                expires_at=now + LASTS,
            )
        )
        if role is None:
            audit.note(session, now, actor, "reset link made", account=email)
        else:
            audit.note(session, now, actor, "account invited", account=email, role=role.value)
    return f"/invitations/{token}"


def _invited(row: Invitation) -> Invited:
    role = None if row.role is None else Role(row.role)
    return Invited(row.id, row.email, role, row.created_at, row.expires_at)
