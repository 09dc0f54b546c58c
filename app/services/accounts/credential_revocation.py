"""Ends the ways into an account: its sign-ins, its API tokens, and its links that nobody has used.

Each of them lets its holder in without the password, so each has to go when the password, the role
or the account itself is no longer what it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete
from sqlalchemy.orm import Session

from app.storage.models.accounts import Account, ApiToken, Invitation, SignIn


@dataclass(frozen=True)
class Ended:
    """How many ways in were ended."""

    sign_ins: int
    tokens: int
    links: int

    def noted(self) -> dict[str, Any]:
        """The same as details for the audit trail, without what there was none of."""
        counts = {"sign_ins": self.sign_ins, "tokens": self.tokens, "links": self.links}
        return {name: count for name, count in counts.items() if count}


def end_all(db: Session, account: Account, *, but_sign_in: int | None = None) -> Ended:
    """End every way into the account within a transaction.

    but_sign_in: the sign-in of the browser that asked, which may stay signed in.
    """
    sign_ins = db.scalars(
        delete(SignIn)
        .where(SignIn.account_id == account.id, SignIn.id != (but_sign_in or 0))
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
    return Ended(len(sign_ins), len(tokens), len(links))
