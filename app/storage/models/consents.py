"""The tables of who agreed to what, and of how many declined."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import CheckConstraint, ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base


class ConsentRow(Base):
    """That a session's person agreed to the consent of one version of the plan. Only added to."""

    __tablename__ = "consents"
    __table_args__ = (UniqueConstraint("session_id", "plan_id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(ForeignKey("sessions.id", ondelete="CASCADE"))
    plan_id: Mapped[int] = mapped_column(ForeignKey("plans.id", ondelete="CASCADE"))
    consent_version: Mapped[str] = mapped_column(String(12))
    # None: an agreement that was renewed before its time was kept.
    agreed_at: Mapped[datetime | None]


class DeclinedCount(Base):
    """How often somebody declined on the consent page of a study, by the day: no session, no id."""

    __tablename__ = "declined_counts"
    __table_args__ = (
        UniqueConstraint("study_id", "day"),
        CheckConstraint("number > 0", name="number"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    # Midnight of the day, UTC.
    day: Mapped[datetime]
    number: Mapped[int]
