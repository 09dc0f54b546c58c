"""The tables of what was done: the audit trail, work under way, studies being made, and faults."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base, one_of


class AuditEvent(Base):
    """What somebody who runs studies did. Only ever added to: the database refuses the rest.

    It names accounts and studies as they were called then, so that it outlives both, and holds
    nothing of a participant but pseudonyms.
    """

    __tablename__ = "audit_events"
    __table_args__ = (Index("ix_audit_events_study_slug", "study_slug"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    happened_at: Mapped[datetime]
    # An account's address; "command line" or "retention rule" where no account did it.
    actor: Mapped[str] = mapped_column(String(254))
    action: Mapped[str] = mapped_column(String(40))
    study_slug: Mapped[str | None] = mapped_column(String(60))
    details: Mapped[dict[str, Any]]


class Job(Base):
    """Work that somebody asked for and watches: a simulation, a transcoding, a report."""

    __tablename__ = "jobs"
    __table_args__ = (
        one_of("state", "waiting", "running", "done", "failed"),
        CheckConstraint("done >= 0 AND done <= total", name="progress"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    public_id: Mapped[str] = mapped_column(String(32), unique=True)
    account_id: Mapped[int | None] = mapped_column(ForeignKey("accounts.id", ondelete="CASCADE"))
    study_id: Mapped[int | None] = mapped_column(
        ForeignKey("studies.id", ondelete="CASCADE"), index=True
    )
    kind: Mapped[str] = mapped_column(String(20))
    state: Mapped[str] = mapped_column(String(8))
    done: Mapped[int]
    total: Mapped[int]
    request: Mapped[dict[str, Any]]
    # What came of it, or why nothing did, in a sentence.
    message: Mapped[str | None] = mapped_column(Text)
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    # While it runs it says so now and then; a job that fell silent is begun again.
    seen_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]


class StudyDraft(Base):
    """A study folder being made in the browser: its files lie in the uploads folder."""

    __tablename__ = "study_drafts"

    id: Mapped[int] = mapped_column(primary_key=True)
    public_id: Mapped[str] = mapped_column(String(32), unique=True)
    account_id: Mapped[int] = mapped_column(
        ForeignKey("accounts.id", ondelete="CASCADE"), index=True
    )
    name: Mapped[str] = mapped_column(String(100))
    created_at: Mapped[datetime]
    changed_at: Mapped[datetime]


class FaultCount(Base):
    """How often something of ours failed in a study within an hour: a count, and nobody's data."""

    __tablename__ = "fault_counts"
    __table_args__ = (
        UniqueConstraint("study_id", "kind", "hour"),
        CheckConstraint("number > 0", name="number"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    # What failed: a page, a call, a video, the database.
    kind: Mapped[str] = mapped_column(String(20))
    # The beginning of the hour.
    hour: Mapped[datetime]
    number: Mapped[int]
    last_at: Mapped[datetime]
