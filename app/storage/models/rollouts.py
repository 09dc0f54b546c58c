"""Tables of machines that record videos while a study runs, and of the rollouts asked of them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    ForeignKey,
    Index,
    String,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import Mapped, mapped_column, relationship

from .studies import Base, Candidate, Recording, one_of

#: A rollout in one of these states may still become a recording: one of them for each candidate.
OUTSTANDING = ("asked", "claimed")
_OUTSTANDING = text("status IN ('asked', 'claimed')")


class Machine(Base):
    """A robot, simulator or generator that records videos of one study. Its token opens no more."""

    __tablename__ = "machines"
    __table_args__ = (UniqueConstraint("study_id", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    name: Mapped[str] = mapped_column(String(60))
    # Shown once; only its hash is kept. None: the machine inside the server, and the desk.
    token_hash: Mapped[str | None] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime]
    revoked_at: Mapped[datetime | None]
    last_seen_at: Mapped[datetime | None]


class Rollout(Base):
    """One run asked of machines: a candidate, a seed, why it is asked, and what became of it."""

    __tablename__ = "rollouts"
    __table_args__ = (
        UniqueConstraint("candidate_id", "run_index"),
        one_of(
            "status",
            "asked",
            "claimed",
            "recorded",
            "failed",
            "unsafe",
            "cancelled",
            "withdrawn",
        ),
        one_of("reason", "query", "ahead", "acquired"),
        CheckConstraint("attempt >= 0", name="attempt"),
        CheckConstraint("progress IS NULL OR (progress >= 0 AND progress <= 1)", name="progress"),
        Index("ix_rollouts_study_id_status_priority", "study_id", "status", "priority"),
        # Two sessions that need the same candidate wait for the same rollout.
        Index(
            "uq_rollouts_outstanding",
            "candidate_id",
            unique=True,
            sqlite_where=_OUTSTANDING,
            postgresql_where=_OUTSTANDING,
        ),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    public_id: Mapped[str] = mapped_column(String(32), unique=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    environment: Mapped[str] = mapped_column(String(60))
    candidate_id: Mapped[int] = mapped_column(ForeignKey("candidates.id", ondelete="CASCADE"))
    # Number of the run among those of its candidate, and the seed that the machine is given.
    run_index: Mapped[int]
    seed: Mapped[int] = mapped_column(BigInteger)
    # A query waits for it; it is asked for ahead; or it shows the acquired candidate.
    reason: Mapped[str] = mapped_column(String(10))
    # The smallest number is claimed first.
    priority: Mapped[int]
    # The trial that asked for it; None if that was deleted.
    trial_id: Mapped[int | None] = mapped_column(
        ForeignKey("trials.id", ondelete="SET NULL"), index=True
    )
    status: Mapped[str] = mapped_column(String(10))
    # How often it was claimed; names the lease as well.
    attempt: Mapped[int] = mapped_column(default=0)
    machine_id: Mapped[int | None] = mapped_column(ForeignKey("machines.id", ondelete="SET NULL"))
    lease_until: Mapped[datetime | None]
    progress: Mapped[float | None]
    asked_at: Mapped[datetime]
    claimed_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]
    # In the machine's or the experimenter's words: why it failed, was unsafe or was withdrawn.
    explanation: Mapped[str | None] = mapped_column(Text)
    # Attempts that failed: attempt, machine, time and reason of each.
    failures: Mapped[list[Any]] = mapped_column(JSON, default=list, server_default="[]")
    recording_id: Mapped[int | None] = mapped_column(
        ForeignKey("recordings.id", ondelete="CASCADE"), index=True
    )
    # SHA-256 of the bytes that the machine sent.
    sha256: Mapped[str | None] = mapped_column(String(64))
    # The machine's own numbers: exported, never shown to evaluators nor to the optimiser.
    score: Mapped[float | None]
    series: Mapped[dict[str, Any] | None]

    candidate: Mapped[Candidate] = relationship()
    machine: Mapped[Machine | None] = relationship()
    recording: Mapped[Recording | None] = relationship()
