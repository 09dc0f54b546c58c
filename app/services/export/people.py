"""Tables of sessions, participants, deletions and questionnaires, and, apart, of identities."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from sqlalchemy import and_, func, or_, select
from sqlalchemy.orm import Session

from app.services.monitoring import data_quality
from app.services.sessions.questionnaires import AT_THE_END_INDEX
from app.services.studies.repository import stored_plan
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import (
    Identity,
    Participant,
    PlanVersion,
    QuestionnaireAnswer,
    SessionRow,
    Trial,
)
from app.study.plan import Plan
from app.study.stage_settings import PRACTICE_INDEX
from app.study.stages import AFTER_TRIAL, AT_THE_END

from .table import (
    MODE,
    PARTICIPANT,
    PLAN_HASH,
    SESSION,
    STUDY,
    Column,
    Request,
    Row,
    Table,
    at_trials_of,
    fetch,
    integer,
    moment,
    of_sessions,
    sessions_of,
    text,
)

_FLAGS = " ".join(f"{flag}: {rule}" for flag, rule in data_quality.RULES.items())


def _sessions_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        PLAN_HASH,
        PARTICIPANT,
        SESSION,
        MODE,
        text("platform", "Recruitment platform that the participant came from, if any."),
        text("language", "Language of the pages."),
        integer("order_index", "Which order of conditions the session was given."),
        text(
            "conditions", "Names of the conditions in the order of the trials, with '; ' between."
        ),
        text(
            "skip_reason_order",
            "Reasons of a skip in the order in which the pages list them, drawn for the session,"
            " with '; ' between; empty without reasons, and where they stood as in the plan.",
        ),
        text("stage", "Where the session stands."),
        integer("trials_finished", "Trials that have all their responses."),
        integer("videos_watched", "Familiarisation videos that were watched to the end."),
        text("consent_version", "Version of the consent last agreed to; see consents.csv."),
        integer("seed", "Seed of the session."),
        text("evaluator", "Kind of simulated evaluator that answered; empty for a person."),
        text("evaluator_settings", "Settings of the simulated evaluator, as JSON."),
        integer("evaluator_seed", "Seed of the simulated evaluator."),
        moment("started_at", "When the session began."),
        moment("consented_at", "When the participant last agreed; see consents.csv."),
        moment("last_seen_at", "When the session last did anything."),
        moment("ended_at", "When it was completed, or left."),
        text("flags", "What was noticed of its answers, with '; ' between: " + _FLAGS),
    )


def _sessions_rows(db: Session, request: Request) -> Iterator[Row]:
    finished = (
        select(Trial.session_id, func.count(Trial.ended_at).label("finished"))
        .where(Trial.trial_index != PRACTICE_INDEX)
        .group_by(Trial.session_id)
        .subquery()
    )
    noticed = data_quality.flags(db, request.study.id, request.modes)
    statement = of_sessions(
        select(SessionRow, Participant.pseudonym, finished.c.finished)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .outerjoin(finished, finished.c.session_id == SessionRow.id),
        request,
    ).order_by(SessionRow.id)
    versions = _versions(db, request)
    for row, pseudonym, trials_finished in fetch(db, statement):
        version = versions[row.plan_id]
        conditions = [condition["name"] for condition in version.plan["conditions"]]
        yield (
            request.study.slug,
            version.plan_hash,
            pseudonym,
            row.public_id,
            row.mode,
            row.platform,
            row.language,
            row.order_index,
            # Names may contain spaces, but no semicolons.
            "; ".join(conditions[index] for index in row.trial_conditions),
            "; ".join(row.skip_reason_order or ()) or None,
            row.stage,
            trials_finished or 0,
            len(row.watched),
            row.consent_version,
            row.seed,
            *_evaluator(row.evaluator),
            row.started_at,
            row.consented_at,
            row.last_seen_at,
            row.ended_at,
            "; ".join(noticed.get(row.id, ())),
        )


def _evaluator(evaluator: Mapping[str, Any] | None) -> Row:
    """Kind, settings and seed of a simulated evaluator."""
    if evaluator is None:
        return None, None, None
    settings = {name: evaluator[name] for name in sorted(evaluator.keys() - {"kind", "seed"})}
    return evaluator["kind"], json.dumps(settings), evaluator["seed"]


def _versions(db: Session, request: Request) -> dict[int, PlanVersion]:
    """The versions of the plan by primary key, read once instead of for each row."""
    found = db.scalars(select(PlanVersion).where(PlanVersion.study_id == request.study.id))
    return {version.id: version for version in found}


def _participants_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        PARTICIPANT,
        integer("sessions", "How many sessions of the exported modes the participant has."),
        moment("created_at", "When the participant first came."),
    )


def _participants_rows(db: Session, request: Request) -> Iterator[Row]:
    statement = (
        of_sessions(
            select(Participant.pseudonym, func.count(SessionRow.id), Participant.created_at).join(
                SessionRow, SessionRow.participant_id == Participant.id
            ),
            request,
        )
        .group_by(Participant.id, Participant.pseudonym, Participant.created_at)
        .order_by(Participant.id)
    )
    for pseudonym, number_of_sessions, created_at in fetch(db, statement):
        yield request.study.slug, pseudonym, number_of_sessions, created_at


def _identities_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        PARTICIPANT,
        text("key", "What the platform calls the id, such as PROLIFIC_PID."),
        text("value", "The id."),
        moment("created_at", "When it was given."),
    )


def _identities_rows(db: Session, request: Request) -> Iterator[Row]:
    wanted = of_sessions(select(SessionRow.participant_id), request)
    statement = (
        select(Participant.pseudonym, Identity.key, Identity.value, Identity.created_at)
        .join(Participant, Identity.participant_id == Participant.id)
        .where(Participant.id.in_(wanted))
        .order_by(Participant.id, Identity.key)
    )
    for row in fetch(db, statement):
        yield tuple(row)


def _deletions_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        MODE,
        text("stage", "The stage that the session had come to."),
        text("reason", "wish: its person's; retention: the study keeps nothing for longer."),
        moment("deleted_on", "The day of the deletion, at 00:00."),
    )


def _deletions_rows(db: Session, request: Request) -> Iterator[Row]:
    statement = (
        select(Tombstone.mode, Tombstone.stage, Tombstone.reason, Tombstone.deleted_at)
        .where(Tombstone.study_id == request.study.id, Tombstone.mode.in_(request.modes))
        # Sorted so that the order within a day is not revealed.
        .order_by(Tombstone.deleted_at, Tombstone.mode, Tombstone.stage, Tombstone.reason)
    )
    for row in fetch(db, statement):
        yield request.study.slug, *row


def _questionnaires_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        PARTICIPANT,
        SESSION,
        integer("trial_index", "Trial that was just finished, from 0; -1 for what ends the study."),
        text("item", "Name of the item."),
        text("type", "likert, number, text or choice."),
        text(
            "value",
            "The answer; a likert item counts its points from 1, a choice has its name. Empty: not"
            " answered.",
        ),
        moment("answered_at", "When the server stored the answer."),
    )


def _questionnaires_rows(db: Session, request: Request) -> Iterator[Row]:
    of = (QuestionnaireAnswer.session_id, QuestionnaireAnswer.trial_index)
    statement = (
        select(SessionRow.public_id, Participant.pseudonym, SessionRow.plan_id, QuestionnaireAnswer)
        .join(SessionRow, QuestionnaireAnswer.session_id == SessionRow.id)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .where(
            or_(
                and_(of[1] == AT_THE_END_INDEX, *sessions_of(request)),
                and_(*at_trials_of(request, *of)),
            )
        )
        .order_by(SessionRow.id, QuestionnaireAnswer.id)
    )
    versions = _versions(db, request)
    for session_id, pseudonym, plan_id, row in fetch(db, statement):
        at_the_end = row.trial_index == AT_THE_END_INDEX
        asked = stored_plan(versions[plan_id]).items(AT_THE_END if at_the_end else AFTER_TRIAL)
        types = {item.name: item.type for item in asked}
        yield (
            pseudonym,
            session_id,
            row.trial_index,
            row.item,
            types[row.item],
            row.value,
            row.answered_at,
        )


SESSIONS = Table("sessions", "One row per session.", _sessions_columns, _sessions_rows)
PARTICIPANTS = Table(
    "participants", "One row per participant.", _participants_columns, _participants_rows
)
QUESTIONNAIRES = Table(
    "questionnaires",
    "One row per item asked after a trial or at the end.",
    _questionnaires_columns,
    _questionnaires_rows,
)
IDENTITIES = Table(
    "identities",
    "Ids of recruitment platforms: only on request.",
    _identities_columns,
    _identities_rows,
)
DELETIONS = Table(
    "deletions",
    "One row per session that was deleted: that it was, and no more.",
    _deletions_columns,
    _deletions_rows,
)
