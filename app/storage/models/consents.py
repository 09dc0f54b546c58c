"""Tables of consents, and of the number of people who declined."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import CheckConstraint, ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base


class ConsentRow(Base):
    """A participant's consent under one version of the plan. Append-only."""

    __tablename__ = "consents"
    __table_args__ = (UniqueConstraint("session_id", "plan_id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(ForeignKey("sessions.id", ondelete="CASCADE"))
    plan_id: Mapped[int] = mapped_column(ForeignKey("plans.id", ondelete="CASCADE"))
    consent_version: Mapped[str] = mapped_column(String(12))
    # None: a consent that was renewed before times were stored.
    agreed_at: Mapped[datetime | None]


class DeclinedCount(Base):
    """Number of people who declined on a study's consent page, by day; without session or id."""

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
