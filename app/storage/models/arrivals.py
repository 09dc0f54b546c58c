"""Tables of arrival and deletion: entry links, re-entries, and what is kept of deleted sessions."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import JSON, ForeignKey, String
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base, one_of


class EntryLink(Base):
    """A single-use link into a study, issued by its experimenter."""

    __tablename__ = "entry_links"

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"), index=True)
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    label: Mapped[str] = mapped_column(String(100))
    created_at: Mapped[datetime]
    used_at: Mapped[datetime | None]


class Reentry(Base):
    """A further token of a session, for its participant who returned in another browser."""

    __tablename__ = "reentries"

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(
        ForeignKey("sessions.id", ondelete="CASCADE"), index=True
    )
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    receipt_hash: Mapped[str] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime]


class Tombstone(Base):
    """Records that a session was deleted, and why, for the counts. Contains no personal data."""

    __tablename__ = "tombstones"
    __table_args__ = (one_of("reason", "wish", "retention"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"), index=True)
    mode: Mapped[str] = mapped_column(String(10))
    stage: Mapped[str] = mapped_column(String(16))
    # At the participant's wish, or by the study's retention rule.
    reason: Mapped[str] = mapped_column(String(10))
    deleted_at: Mapped[datetime]


class DeletedStudy(Base):
    """Records that a study was deleted, with the return link for its participants."""

    __tablename__ = "deleted_studies"

    id: Mapped[int] = mapped_column(primary_key=True)
    slug: Mapped[str] = mapped_column(String(60), unique=True)
    # The platform's technical code and address, as the plan had them.
    way_back: Mapped[dict[str, Any] | None] = mapped_column(JSON)
    # The day: see `Tombstone`.
    deleted_on: Mapped[datetime]


class DeletedSession(Base):
    """A session that was deleted with its study, so that its browser can be told so."""

    __tablename__ = "deleted_sessions"

    id: Mapped[int] = mapped_column(primary_key=True)
    deleted_study_id: Mapped[int] = mapped_column(
        ForeignKey("deleted_studies.id", ondelete="CASCADE"), index=True
    )
    # A hash of the session's random token, different from the one in backups.
    token_key: Mapped[str] = mapped_column(String(64), unique=True)
