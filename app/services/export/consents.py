"""The table of consents: which session agreed to which version, and when."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.models.consents import ConsentRow
from app.storage.models.studies import Participant, PlanVersion, SessionRow
from app.study.plan import Plan

from .table import (
    PARTICIPANT,
    SESSION,
    STUDY,
    Column,
    Request,
    Row,
    Table,
    fetch,
    integer,
    moment,
    of_sessions,
    text,
)


def _columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        PARTICIPANT,
        SESSION,
        integer("consent_index", "Number of the agreement in its session, from 0."),
        integer("plan_version", "Number of the version of plan and texts that it belongs to."),
        text("plan_hash", "SHA-256 of that plan, its texts and recordings."),
        text("language", "Language that the consent was read in."),
        text("consent_version", "Version of the consent's text."),
        moment(
            "agreed_at",
            "When the participant agreed; empty for one that was renewed before its time was kept.",
        ),
    )


def _rows(db: Session, request: Request) -> Iterator[Row]:
    statement = of_sessions(
        select(
            SessionRow.id,
            SessionRow.public_id,
            SessionRow.language,
            Participant.pseudonym,
            PlanVersion.version,
            PlanVersion.plan_hash,
            ConsentRow.consent_version,
            ConsentRow.agreed_at,
        )
        .join(ConsentRow, ConsentRow.session_id == SessionRow.id)
        .join(PlanVersion, ConsentRow.plan_id == PlanVersion.id)
        .join(Participant, SessionRow.participant_id == Participant.id),
        request,
    ).order_by(SessionRow.id, PlanVersion.version)
    before, index = None, 0
    for key, public_id, language, pseudonym, number, digest, version, at in fetch(db, statement):
        index = index + 1 if key == before else 0
        before = key
        yield (
            request.study.slug,
            pseudonym,
            public_id,
            index,
            number,
            digest,
            language,
            version,
            at,
        )


CONSENTS = Table(
    "consents",
    "Each agreement to a consent; a changed text is agreed to anew.",
    _columns,
    _rows,
)
