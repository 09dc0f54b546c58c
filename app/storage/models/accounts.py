"""Tables of accounts: sign-ins, API tokens, invitations, and access to studies.

Secrets (sign-ins, API tokens, invitations) are stored as hashes only.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from .studies import Base, one_of


class Account(Base):
    """An account of a person who runs or reviews studies."""

    __tablename__ = "accounts"
    __table_args__ = (one_of("role", "admin", "experimenter", "reviewer"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    email: Mapped[str] = mapped_column(String(254), unique=True)
    password_hash: Mapped[str] = mapped_column(String(200))
    role: Mapped[str] = mapped_column(String(12))
    created_at: Mapped[datetime]
    # Since when the account cannot sign in; its audit events remain.
    disabled_at: Mapped[datetime | None]


class SignIn(Base):
    """A signed-in browser."""

    __tablename__ = "sign_ins"

    id: Mapped[int] = mapped_column(primary_key=True)
    account_id: Mapped[int] = mapped_column(ForeignKey("accounts.id", ondelete="CASCADE"))
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]

    account: Mapped[Account] = relationship()


class ApiToken(Base):
    """A token for programs. Shown once; only its hash is kept."""

    __tablename__ = "api_tokens"
    __table_args__ = (one_of("scope", "read", "identities", "write"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    account_id: Mapped[int] = mapped_column(ForeignKey("accounts.id", ondelete="CASCADE"))
    label: Mapped[str] = mapped_column(String(100))
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    # read: view and export; identities: platforms' ids as well; write: everything the account may.
    scope: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]

    account: Mapped[Account] = relationship()


class Invitation(Base):
    """A single-use link to choose a password, for a new account or a lost password."""

    __tablename__ = "invitations"
    __table_args__ = (one_of("role", "admin", "experimenter", "reviewer"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    email: Mapped[str] = mapped_column(String(254))
    # Role of the new account; None: reset the password of the account with this address.
    role: Mapped[str | None] = mapped_column(String(12))
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]
    used_at: Mapped[datetime | None]


class FailedSignIn(Base):
    """A failed sign-in, kept for minutes only, for the rate limit on password guessing."""

    __tablename__ = "failed_sign_ins"
    __table_args__ = (Index("ix_failed_sign_ins_key_hash_failed_at", "key_hash", "failed_at"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    # Of the address that was tried; there need not be an account with it.
    key_hash: Mapped[str] = mapped_column(String(64))
    failed_at: Mapped[datetime]


class StudyAccess(Base):
    """An account's access to a study, as its owner or shared."""

    __tablename__ = "study_access"
    __table_args__ = (
        UniqueConstraint("study_id", "account_id"),
        one_of("access", "owner", "shared"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    account_id: Mapped[int] = mapped_column(
        ForeignKey("accounts.id", ondelete="CASCADE"), index=True
    )
    access: Mapped[str] = mapped_column(String(6))
    created_at: Mapped[datetime]
