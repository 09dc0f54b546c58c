"""Tables of the audit trail, jobs, study drafts, and failure counts."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base, one_of


class AuditEvent(Base):
    """An action of an experimenter or of the server. Append-only: the database refuses changes.

    Accounts and studies are stored by their names at the time, so that the event outlives them.
    Participants appear by pseudonym only.
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
    """A long-running job that an experimenter requested, such as a simulation or a transcoding."""

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
    # The result, or why the job failed, as a sentence.
    message: Mapped[str | None] = mapped_column(Text)
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    # Heartbeat of the running job; a job without a recent one is restarted.
    seen_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]


class StudyDraft(Base):
    """A study folder that is being edited in the browser; its files are in the uploads folder."""

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
    """Number of server-side failures of one kind in a study within one hour."""

    __tablename__ = "fault_counts"
    __table_args__ = (
        UniqueConstraint("study_id", "kind", "hour"),
        CheckConstraint("number > 0", name="number"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    # What failed: a page, a call, a video, the database.
    kind: Mapped[str] = mapped_column(String(20))
    # Start of the hour, UTC.
    hour: Mapped[datetime]
    number: Mapped[int]
    last_at: Mapped[datetime]
