"""The part of a report on the versions of plan, texts and software, for reproducibility."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator
from importlib.metadata import version

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from app import __version__
from app.services.export.table import Request, of_sessions, of_trials
from app.services.studies.repository import StudyInfo
from app.storage.models.consents import ConsentRow
from app.storage.models.studies import PlanVersion, QueryRow, Response, SessionRow, Trial
from app.study.markdown import consent_version

from .document import Block, Heading, Paragraph, Table

#: Packages that proposals, statistics and figures depend on.
LIBRARIES = ("torch", "numpy", "scipy", "sqlalchemy", "altair", "vl-convert-python", "av")


def versions(db: Session, request: Request, queries_sha256: str) -> Iterator[Block]:
    """The blocks of this part. queries_sha256: of queries.csv with the same filter."""
    yield Heading("Versions")
    yield Table(
        "Plans that sessions ran under",
        ("Version", "SHA-256 of plan, texts and recordings", "Sessions", "Answers"),
        list(_plans(db, request)),
    )
    yield Table(
        "Engines that chose the queries",
        ("Version of the optimiser", "Queries"),
        list(_engines(db, request)),
    )
    yield Table(
        "Texts of the newest plan",
        ("Language", "Text", "Version"),
        list(_texts(request.study)),
    )
    yield Table(
        "Consents that were agreed to",
        ("Version", "Sessions", "Answers"),
        list(_consents(db, request)),
    )
    yield Table(
        "Software that made this report",
        ("Software", "Version"),
        [
            ("PBPO Studio", __version__),
            ("Python", platform.python_version()),
            *((name, version(name)) for name in LIBRARIES),
        ],
    )
    yield Paragraph(
        "Every session has a random seed of its own, and every trial the seed of its proposals: the"
        " columns seed of sessions.csv and queries.csv. From them and the answers, pbpo replay"
        f" {request.study.slug} works every query out again. The numbers of this report are those"
        f" of queries.csv with the SHA-256 {queries_sha256}."
    )


def _plans(db: Session, request: Request) -> Iterator[tuple[str, ...]]:
    """Rows by version of the plan: sessions that consented under it, and answers given under it."""
    sessions = of_sessions(
        select(ConsentRow.plan_id, func.count(SessionRow.id))
        .join(SessionRow, ConsentRow.session_id == SessionRow.id)
        .group_by(ConsentRow.plan_id),
        request,
    )
    of_plan: dict[int, int] = dict(db.execute(sessions).all())
    answers = _answers_under(db, request)
    statement = (
        select(PlanVersion.id, PlanVersion.version, PlanVersion.plan_hash)
        .where(PlanVersion.study_id == request.study.id)
        .order_by(PlanVersion.version)
    )
    for plan_id, number, digest in db.execute(statement):
        if plan_id in of_plan or plan_id in answers:
            yield str(number), digest, str(of_plan.get(plan_id, 0)), str(answers.get(plan_id, 0))
    if None in answers:
        yield "unknown", "", "", str(answers[None])


def _answers_under(db: Session, request: Request) -> dict[int | None, int]:
    statement = of_trials(
        select(Response.plan_id, func.count(Response.id))
        .join(QueryRow, Response.query_id == QueryRow.id)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(Trial.trial_index >= 0)
        .group_by(Response.plan_id),
        request,
    )
    return dict(db.execute(statement).all())


def _engines(db: Session, request: Request) -> Iterator[tuple[str, ...]]:
    statement = of_trials(
        select(QueryRow.engine_version, func.count(QueryRow.id))
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(QueryRow.set_aside_at.is_(None), Trial.trial_index >= 0)
        .group_by(QueryRow.engine_version)
        .order_by(QueryRow.engine_version),
        request,
    )
    for engine, count in db.execute(statement):
        yield engine, str(count)


def _texts(study: StudyInfo) -> Iterator[tuple[str, ...]]:
    """Rows by text: a consent with its version, other texts with the start of their SHA-256."""
    for language, named in sorted(study.texts.items()):
        for name, text in sorted(named.items()):
            digest = hashlib.sha256(text.encode("utf-8")).hexdigest()[:12]
            yield language, name, consent_version(text) if name == "consent" else digest


def _consents(db: Session, request: Request) -> Iterator[tuple[str, ...]]:
    """Rows by version of the consent: sessions that agreed to it, and answers given under it."""
    statement = of_sessions(
        select(ConsentRow.consent_version, func.count(SessionRow.id.distinct()))
        .join(SessionRow, ConsentRow.session_id == SessionRow.id)
        .group_by(ConsentRow.consent_version)
        .order_by(ConsentRow.consent_version),
        request,
    )
    given = of_trials(
        select(ConsentRow.consent_version, func.count(Response.id))
        .join(SessionRow, ConsentRow.session_id == SessionRow.id)
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(
            Response,
            and_(Response.query_id == QueryRow.id, Response.plan_id == ConsentRow.plan_id),
        )
        .where(Trial.trial_index >= 0)
        .group_by(ConsentRow.consent_version),
        request,
    )
    answers: dict[str, int] = dict(db.execute(given).all())
    for agreed, count in db.execute(statement):
        yield agreed, str(count), str(answers.get(agreed, 0))
