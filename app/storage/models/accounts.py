"""The tables of those who run studies: accounts and how they get in, and whose a study is.

Secrets (sign-ins, API tokens, invitations) are kept as hashes alone.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from .studies import Base, one_of


class Account(Base):
    """Somebody who runs studies, or reads about them."""

    __tablename__ = "accounts"
    __table_args__ = (one_of("role", "admin", "experimenter", "reviewer"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    email: Mapped[str] = mapped_column(String(254), unique=True)
    password_hash: Mapped[str] = mapped_column(String(200))
    role: Mapped[str] = mapped_column(String(12))
    created_at: Mapped[datetime]
    # Since when nobody can sign in with it; what its owner did stays in the record.
    disabled_at: Mapped[datetime | None]


class SignIn(Base):
    """A browser in which somebody is signed in."""

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
    # read: looks and exports; identities: platforms' ids too; write: all that its account may do.
    scope: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]

    account: Mapped[Account] = relationship()


class Invitation(Base):
    """A link that lets somebody choose a password, once: for a new account or a lost password."""

    __tablename__ = "invitations"
    __table_args__ = (one_of("role", "admin", "experimenter", "reviewer"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    email: Mapped[str] = mapped_column(String(254))
    # Of the account to be made; None: the account of that address gets another password.
    role: Mapped[str | None] = mapped_column(String(12))
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]
    used_at: Mapped[datetime | None]


class FailedSignIn(Base):
    """A password that was wrong, kept for minutes only, to slow down who guesses."""

    __tablename__ = "failed_sign_ins"
    __table_args__ = (Index("ix_failed_sign_ins_key_hash_failed_at", "key_hash", "failed_at"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    # Of the address tried: it may be nobody's.
    key_hash: Mapped[str] = mapped_column(String(64))
    failed_at: Mapped[datetime]


class StudyAccess(Base):
    """Whose a study is, and whom it is shared with."""

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
