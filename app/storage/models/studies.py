"""Tables of a study: plan, candidates, recordings, sessions, queries and responses.

Every invariant is a named constraint, so that the database protects the data even from faulty code.
Responses are append-only; preferences and acquired candidates are derived from them and can be
recomputed. Ids of platforms are stored in `identities` only.
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
    """Base of all models: constraint names, and column types by annotation."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map: ClassVar = {
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[int]: JSON,
        list[str]: JSON,
    }


def one_of(column: str, *values: str) -> CheckConstraint:
    """A constraint that the column has one of these values (or NULL, if it is nullable)."""
    allowed = ", ".join(f"'{value}'" for value in values)
    return CheckConstraint(f"{column} IN ({allowed})", name=column)


class Study(Base):
    """One experiment. Its plan can have several versions; a session keeps the one it began with."""

    __tablename__ = "studies"
    __table_args__ = (
        one_of("status", "draft", "open", "closed"),
        # Ids are never reused: servers cache a study's candidates by id.
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    slug: Mapped[str] = mapped_column(String(60), unique=True)
    status: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    opened_at: Mapped[datetime | None]
    closed_at: Mapped[datetime | None]
    # Since when an open study is paused for new participants.
    paused_at: Mapped[datetime | None]
    # Hash of the secret in the pilot link; None if there is no such link.
    pilot_link_hash: Mapped[str | None] = mapped_column(String(64), unique=True, index=True)
    # Names of conditions that are no longer assigned to new sessions.
    conditions_off: Mapped[list[str]] = mapped_column(default=list, server_default="[]")
    # Since when no machine is given work: the emergency stop.
    machines_stopped_at: Mapped[datetime | None]

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
    __table_args__ = (
        UniqueConstraint("study_id", "environment", "candidate_index"),
        UniqueConstraint("study_id", "environment", "point_key"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    environment: Mapped[str] = mapped_column(String(60))
    candidate_index: Mapped[int]
    parameters: Mapped[dict[str, Any]]
    # In a box, what tells points apart; None for candidates of a list.
    point_key: Mapped[str | None] = mapped_column(String(200))

    recordings: Mapped[list[Recording]] = relationship(
        back_populates="candidate", cascade="all, delete-orphan"
    )


class Recording(Base):
    """One recorded run of a candidate. Browsers only ever see its `public_id`."""

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
    # For a file: SHA-256 of its content, and extension. For the crane: environment/candidate/run.
    locator: Mapped[str] = mapped_column(String(200))
    # Name of the experimenter's original file; None for the crane.
    file: Mapped[str | None] = mapped_column(Text)
    duration_s: Mapped[float]
    score: Mapped[float | None]

    candidate: Mapped[Candidate] = relationship(back_populates="recordings")


class Participant(Base):
    """A participant of a study, identified by a random pseudonym."""

    __tablename__ = "participants"

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"), index=True)
    pseudonym: Mapped[str] = mapped_column(String(24), unique=True)
    created_at: Mapped[datetime]


class Identity(Base):
    """A platform's id of a participant: stored apart, exported only on request, erasable alone."""

    __tablename__ = "identities"
    __table_args__ = (UniqueConstraint("participant_id", "key"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    participant_id: Mapped[int] = mapped_column(ForeignKey("participants.id", ondelete="CASCADE"))
    key: Mapped[str] = mapped_column(String(60))
    value: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class SessionRow(Base):
    """One participant's session: its position in the protocol, and the plan it runs under."""

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
    # Names of the reasons of a skip in the order of the pages; None: as in the plan.
    skip_reason_order: Mapped[list[str] | None] = mapped_column(JSON(none_as_null=True))
    stage: Mapped[str] = mapped_column(String(16))
    trial_index: Mapped[int]
    query_index: Mapped[int]
    break_ends_at: Mapped[datetime | None]
    consent_version: Mapped[str | None] = mapped_column(String(12))
    consented_at: Mapped[datetime | None]
    # Recruitment platform that the participant came from; None for a plain link.
    platform: Mapped[str | None] = mapped_column(String(20))
    # Hash of the receipt code, with which the participant can request deletion later.
    receipt_hash: Mapped[str | None] = mapped_column(String(64), unique=True)
    # Indices in the familiarisation playlist that were watched to the end.
    watched: Mapped[list[int]] = mapped_column(default=list)
    # Of a simulated session: the evaluator's kind, settings and seed. See simulated_evaluators.
    evaluator: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    started_at: Mapped[datetime]
    last_seen_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]
    expires_at: Mapped[datetime]
    # Not a column: id of the newest version of the study's plan, if the query selected it.
    newest_plan_id: int | None = None
    __allow_unmapped__ = True

    study: Mapped[Study] = relationship()
    plan: Mapped[PlanVersion] = relationship()
    participant: Mapped[Participant] = relationship()
    trials: Mapped[list[Trial]] = relationship(
        back_populates="session", order_by="Trial.trial_index", cascade="all, delete-orphan"
    )


class Trial(Base):
    """One optimisation run under one condition, with a new model."""

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
    """A query, stored before it is shown: both recordings, their sides, and their acquisition."""

    __tablename__ = "queries"
    __table_args__ = (
        # One query for each index, even with two tabs, retries, or several servers. A query that is
        # set aside for a technical fault is followed by another attempt at the same index.
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
    # None while a machine has not recorded the video yet; the rollout says which run is awaited.
    left_recording_id: Mapped[int | None] = mapped_column(ForeignKey("recordings.id"))
    right_recording_id: Mapped[int | None] = mapped_column(ForeignKey("recordings.id"))
    left_rollout_id: Mapped[int | None] = mapped_column(ForeignKey("rollouts.id"), index=True)
    right_rollout_id: Mapped[int | None] = mapped_column(ForeignKey("rollouts.id"), index=True)
    # In a box, what the proposal was made from besides space and seed: "answered", the indices of
    # the queries learnt from; "pending", the open queries; "excluded", candidates never proposed.
    # Under a shared model, "shared", runs of keys of everybody's responses; "number" and "digest"
    # of these; "avoided", pairs that others were looking at.
    proposed_from: Mapped[dict[str, Any] | None]
    # Since when the response is not learnt from, because a recording of it was withdrawn.
    withdrawn_at: Mapped[datetime | None]
    acquisition: Mapped[str] = mapped_column(String(40))
    seed: Mapped[int] = mapped_column(BigInteger)
    engine_version: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime]
    shown_at: Mapped[datetime | None]
    # For a planned repeat: index of the query of this trial that it repeats with swapped sides.
    repeats_query_index: Mapped[int | None]
    # Set aside for a technical fault: it is replaced, and the model does not learn from it.
    set_aside_at: Mapped[datetime | None]
    fault: Mapped[str | None] = mapped_column(String(200))

    trial: Mapped[Trial] = relationship(back_populates="queries")
    left_recording: Mapped[Recording | None] = relationship(foreign_keys=[left_recording_id])
    right_recording: Mapped[Recording | None] = relationship(foreign_keys=[right_recording_id])
    response: Mapped[Response | None] = relationship(
        back_populates="query", cascade="all, delete-orphan"
    )


class Response(Base):
    """The response to a query. Append-only."""

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
    # Version of plan and texts under which it was given; None for older data.
    plan_id: Mapped[int | None] = mapped_column(ForeignKey("plans.id", ondelete="CASCADE"))

    query: Mapped[QueryRow] = relationship(back_populates="response")


class UndoneResponse(Base):
    """A response that the evaluator undid: kept for the record, not learnt from."""

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
    """A preference that the model learnt from, derived from the responses, with its origin."""

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
    #: Probability that no candidate is better by more than the plan's `within` of the range.
    sureness: Mapped[float | None]
    # In a box or under a shared model, what it was computed from: as `QueryRow.proposed_from`.
    computed_from: Mapped[dict[str, Any] | None]


class Event(Base):
    """An event in the browser during a query: playback, focus, fullscreen."""

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
