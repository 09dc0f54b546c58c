"""Revokes the credentials of an account: its sign-ins, API tokens and unused invitation links.

Each of them gives access without the password, so all are revoked when the password, the role or
the state of the account changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete
from sqlalchemy.orm import Session

from app.storage.models.accounts import Account, ApiToken, Invitation, SignIn


@dataclass(frozen=True)
class Revoked:
    """How many credentials of each kind were revoked."""

    sign_ins: int
    tokens: int
    links: int

    def as_details(self) -> dict[str, Any]:
        """The counts as details for the audit log, without those that are zero."""
        counts = {"sign_ins": self.sign_ins, "tokens": self.tokens, "links": self.links}
        return {name: count for name, count in counts.items() if count}


def revoke_all(db: Session, account: Account, *, except_sign_in: int | None = None) -> Revoked:
    """Revoke every credential of the account within the transaction of `db`.

    except_sign_in: the id of a sign-in to keep, for the browser that made the request.
    """
    sign_ins = db.scalars(
        delete(SignIn)
        .where(SignIn.account_id == account.id, SignIn.id != (except_sign_in or 0))
        .returning(SignIn.id)
    ).all()
    tokens = db.scalars(
        delete(ApiToken).where(ApiToken.account_id == account.id).returning(ApiToken.id)
    ).all()
    links = db.scalars(
        delete(Invitation)
        .where(Invitation.email == account.email, Invitation.used_at.is_(None))
        .returning(Invitation.id)
    ).all()
    return Revoked(len(sign_ins), len(tokens), len(links))
