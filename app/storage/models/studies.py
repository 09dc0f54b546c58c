"""The tables of a study: its plan, its candidates and recordings, and what people answered.

Every invariant that must hold is a named constraint, so that the database defends the data even
where the code is wrong. Responses are append-only; preferences and acquired candidates are derived
from them and could be worked out again. Ids of platforms live in `identities` alone.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any, ClassVar

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    ForeignKey,
    Index,
    MetaData,
    String,
    Text,
    UniqueConstraint,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

from .types import UtcDateTime

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map: ClassVar = {
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[int]: JSON,
        list[str]: JSON,
    }


def one_of(column: str, *values: str) -> CheckConstraint:
    """The column holds one of these values (or NULL, where it may)."""
    allowed = ", ".join(f"'{value}'" for value in values)
    return CheckConstraint(f"{column} IN ({allowed})", name=column)


class Study(Base):
    """One experiment. Its plan may have versions; a session holds on to the one it began."""

    __tablename__ = "studies"
    __table_args__ = (
        one_of("status", "draft", "open", "closed"),
        # An id never comes again: servers remember a study's candidates by it.
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    slug: Mapped[str] = mapped_column(String(60), unique=True)
    status: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    opened_at: Mapped[datetime | None]
    closed_at: Mapped[datetime | None]
    # Since when an open study lets nobody in for a while.
    paused_at: Mapped[datetime | None]
    # Hash of the secret in the link that lets people into a pilot; None while there is none.
    pilot_link_hash: Mapped[str | None] = mapped_column(String(64), unique=True, index=True)
    # Names of conditions that new sessions are not given any more.
    conditions_off: Mapped[list[str]] = mapped_column(default=list, server_default="[]")

    plans: Mapped[list[PlanVersion]] = relationship(
        back_populates="study", order_by="PlanVersion.version", cascade="all, delete-orphan"
    )


class PlanVersion(Base):
    """A plan and its texts, frozen and hashed."""

    __tablename__ = "plans"
    __table_args__ = (UniqueConstraint("study_id", "version"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    version: Mapped[int]
    plan_hash: Mapped[str] = mapped_column(String(64))
    plan: Mapped[dict[str, Any]]
    texts: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]

    study: Mapped[Study] = relationship(back_populates="plans")


class Candidate(Base):
    """A parameter vector of the search space of one environment."""

    __tablename__ = "candidates"
    __table_args__ = (UniqueConstraint("study_id", "environment", "candidate_index"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    environment: Mapped[str] = mapped_column(String(60))
    candidate_index: Mapped[int]
    parameters: Mapped[dict[str, Any]]

    recordings: Mapped[list[Recording]] = relationship(
        back_populates="candidate", cascade="all, delete-orphan"
    )


class Recording(Base):
    """One recorded run of a candidate. `public_id` is all that a browser ever learns of it."""

    __tablename__ = "recordings"
    __table_args__ = (
        UniqueConstraint("candidate_id", "run_index"),
        one_of("source", "file", "crane"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    candidate_id: Mapped[int] = mapped_column(ForeignKey("candidates.id", ondelete="CASCADE"))
    run_index: Mapped[int]
    public_id: Mapped[str] = mapped_column(String(32), unique=True)
    source: Mapped[str] = mapped_column(String(10))
    # For a file: its content's SHA-256 and ending. For the crane: environment/candidate/run.
    locator: Mapped[str] = mapped_column(String(200))
    # What the experimenter's own file was called; None for the crane.
    file: Mapped[str | None] = mapped_column(Text)
    duration_s: Mapped[float]
    score: Mapped[float | None]

    candidate: Mapped[Candidate] = relationship(back_populates="recordings")


class Participant(Base):
    """A person in a study, known by a random pseudonym."""

    __tablename__ = "participants"

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"), index=True)
    pseudonym: Mapped[str] = mapped_column(String(24), unique=True)
    created_at: Mapped[datetime]


class Identity(Base):
    """What a platform calls a participant: kept apart, exported only by name, erasable alone."""

    __tablename__ = "identities"
    __table_args__ = (UniqueConstraint("participant_id", "key"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    participant_id: Mapped[int] = mapped_column(ForeignKey("participants.id", ondelete="CASCADE"))
    key: Mapped[str] = mapped_column(String(60))
    value: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class SessionRow(Base):
    """One passage of a participant through a study: where it stands, and under which plan."""

    __tablename__ = "sessions"
    __table_args__ = (
        one_of("mode", "live", "preview", "pilot", "simulated"),
        one_of(
            "stage",
            "consent",
            "device_check",
            "instructions",
            "familiarisation",
            "practice",
            "query",
            "questionnaire",
            "break",
            "debrief",
            "completed",
            "withdrawn",
            "declined",
            "screened_out",
        ),
        CheckConstraint("trial_index >= 0 AND query_index >= 0", name="position"),
        Index("ix_sessions_study_mode_stage", "study_id", "mode", "stage"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    public_id: Mapped[str] = mapped_column(String(24), unique=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    plan_id: Mapped[int] = mapped_column(ForeignKey("plans.id"))
    participant_id: Mapped[int] = mapped_column(
        ForeignKey("participants.id", ondelete="CASCADE"), index=True
    )
    token_hash: Mapped[str] = mapped_column(String(64), unique=True)
    mode: Mapped[str] = mapped_column(String(10))
    language: Mapped[str] = mapped_column(String(12))
    seed: Mapped[int] = mapped_column(BigInteger)
    order_index: Mapped[int]
    trial_conditions: Mapped[list[int]]
    stage: Mapped[str] = mapped_column(String(16))
    trial_index: Mapped[int]
    query_index: Mapped[int]
    break_ends_at: Mapped[datetime | None]
    consent_version: Mapped[str | None] = mapped_column(String(12))
    consented_at: Mapped[datetime | None]
    # How the person came: a recruitment platform's name, or None for a plain link.
    platform: Mapped[str | None] = mapped_column(String(20))
    # Hash of the code with which the person can ask for deletion later, without an account.
    receipt_hash: Mapped[str | None] = mapped_column(String(64), unique=True)
    # Places in the familiarisation playlist that were watched to the end.
    watched: Mapped[list[int]] = mapped_column(default=list)
    started_at: Mapped[datetime]
    last_seen_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]
    expires_at: Mapped[datetime]
    # No column: the newest version of the study's plan, where whoever read the row has asked.
    newest_plan_id: int | None = None
    __allow_unmapped__ = True

    study: Mapped[Study] = relationship()
    plan: Mapped[PlanVersion] = relationship()
    participant: Mapped[Participant] = relationship()
    trials: Mapped[list[Trial]] = relationship(
        back_populates="session", order_by="Trial.trial_index", cascade="all, delete-orphan"
    )


class Trial(Base):
    """One optimisation run: one condition, one fresh model."""

    __tablename__ = "trials"
    __table_args__ = (UniqueConstraint("session_id", "trial_index"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(ForeignKey("sessions.id", ondelete="CASCADE"))
    trial_index: Mapped[int]
    condition: Mapped[str] = mapped_column(String(60))
    method: Mapped[str] = mapped_column(String(40))
    environment: Mapped[str] = mapped_column(String(60))
    seed: Mapped[int] = mapped_column(BigInteger)
    started_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]

    session: Mapped[SessionRow] = relationship(back_populates="trials")
    queries: Mapped[list[QueryRow]] = relationship(
        back_populates="trial",
        order_by="QueryRow.query_index, QueryRow.attempt",
        cascade="all, delete-orphan",
    )


class QueryRow(Base):
    """A query, stored before it is shown: both recordings, their sides, and what chose them."""

    __tablename__ = "queries"
    __table_args__ = (
        # One proposal for one place: two tabs, a retry or two servers cannot make a second one.
        # A query set aside for a technical fault is followed by another attempt at its place.
        UniqueConstraint("trial_id", "query_index", "attempt"),
        CheckConstraint("attempt >= 0", name="attempt"),
        CheckConstraint("left_candidate <> right_candidate", name="two_candidates"),
        CheckConstraint("query_index >= 0", name="query_index"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    public_id: Mapped[str] = mapped_column(String(32), unique=True)
    trial_id: Mapped[int] = mapped_column(ForeignKey("trials.id", ondelete="CASCADE"))
    query_index: Mapped[int]
    attempt: Mapped[int] = mapped_column(default=0)
    trial_type: Mapped[str] = mapped_column(String(20))
    left_candidate: Mapped[int]
    right_candidate: Mapped[int]
    left_recording_id: Mapped[int] = mapped_column(ForeignKey("recordings.id"))
    right_recording_id: Mapped[int] = mapped_column(ForeignKey("recordings.id"))
    acquisition: Mapped[str] = mapped_column(String(40))
    seed: Mapped[int] = mapped_column(BigInteger)
    engine_version: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime]
    shown_at: Mapped[datetime | None]
    # For a planned repeat: the query of this trial that it shows again, sides swapped.
    repeats_query_index: Mapped[int | None]
    # Set aside for a technical fault: it never reaches the model and is replaced.
    set_aside_at: Mapped[datetime | None]
    fault: Mapped[str | None] = mapped_column(String(200))

    trial: Mapped[Trial] = relationship(back_populates="queries")
    left_recording: Mapped[Recording] = relationship(foreign_keys=[left_recording_id])
    right_recording: Mapped[Recording] = relationship(foreign_keys=[right_recording_id])
    response: Mapped[Response | None] = relationship(
        back_populates="query", cascade="all, delete-orphan"
    )


class Response(Base):
    """What was pressed. Written once, never changed."""

    __tablename__ = "responses"
    __table_args__ = (
        one_of("response", "left", "right", "skip"),
        CheckConstraint("rt_ms IS NULL OR rt_ms >= 0", name="rt"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    query_id: Mapped[int] = mapped_column(ForeignKey("queries.id", ondelete="CASCADE"), unique=True)
    response: Mapped[str] = mapped_column(String(10))
    skip_reason: Mapped[str | None] = mapped_column(String(60))
    rt_ms: Mapped[float | None]
    answered_at: Mapped[datetime]
    # Under which version of plan and texts it was given; None where older data cannot tell.
    plan_id: Mapped[int | None] = mapped_column(ForeignKey("plans.id", ondelete="CASCADE"))

    query: Mapped[QueryRow] = relationship(back_populates="response")


class UndoneResponse(Base):
    """A response that its evaluator took back at once: kept for the record, never learnt from."""

    __tablename__ = "undone_responses"
    __table_args__ = (one_of("response", "left", "right", "skip"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    query_id: Mapped[int] = mapped_column(ForeignKey("queries.id", ondelete="CASCADE"), index=True)
    response: Mapped[str] = mapped_column(String(10))
    skip_reason: Mapped[str | None] = mapped_column(String(60))
    rt_ms: Mapped[float | None]
    answered_at: Mapped[datetime]
    undone_at: Mapped[datetime]


class PreferenceRow(Base):
    """What the model learnt from: derived from the responses, always with its origin."""

    __tablename__ = "preferences"
    __table_args__ = (
        UniqueConstraint("trial_id", "preference_index"),
        one_of("origin", "answer", "synthesis"),
        CheckConstraint("winner <> loser", name="two_candidates"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    trial_id: Mapped[int] = mapped_column(ForeignKey("trials.id", ondelete="CASCADE"))
    preference_index: Mapped[int]
    winner: Mapped[int]
    loser: Mapped[int]
    origin: Mapped[str] = mapped_column(String(10))
    query_index: Mapped[int]
    drawn_from_query_index: Mapped[int | None]


class Acquired(Base):
    """The candidate of the largest posterior mean after each response (w_acq)."""

    __tablename__ = "acquired"
    __table_args__ = (UniqueConstraint("trial_id", "query_index"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    trial_id: Mapped[int] = mapped_column(ForeignKey("trials.id", ondelete="CASCADE"))
    query_index: Mapped[int]
    candidate: Mapped[int]
    posterior_mean: Mapped[float | None]
    posterior_std: Mapped[float | None]


class Event(Base):
    """Something that happened while a query was on the screen: playback, focus, fullscreen."""

    __tablename__ = "events"
    __table_args__ = (
        CheckConstraint("side IS NULL OR side IN ('left', 'right')", name="side"),
        Index("ix_events_session_id", "session_id"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(ForeignKey("sessions.id", ondelete="CASCADE"))
    trial_index: Mapped[int]
    query_index: Mapped[int]
    event: Mapped[str] = mapped_column(String(40))
    side: Mapped[str | None] = mapped_column(String(5))
    time_ms: Mapped[float]
    value: Mapped[str | None] = mapped_column(Text)


class QuestionnaireAnswer(Base):
    """An answer to one item of a questionnaire, after a trial or (trial_index -1) at the end."""

    __tablename__ = "questionnaire_answers"
    __table_args__ = (UniqueConstraint("session_id", "trial_index", "item"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    session_id: Mapped[int] = mapped_column(ForeignKey("sessions.id", ondelete="CASCADE"))
    trial_index: Mapped[int]
    item: Mapped[str] = mapped_column(String(60))
    value: Mapped[str | None] = mapped_column(Text)
    answered_at: Mapped[datetime]
