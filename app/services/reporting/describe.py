"""Assembles the report of a study, from which HTML and PDF are rendered."""

from __future__ import annotations

import hashlib
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from app.services.arrival import decline_counter
from app.services.context import AppContext
from app.services.export.filters import in_words
from app.services.export.stream import csv_stream
from app.services.export.table import Request, sessions_of
from app.services.export.tables import TABLES
from app.services.monitoring import session_list as watched
from app.storage.models.studies import SessionRow

from .design import design, orders_given
from .document import Block, Heading, Report, Table
from .participant_flow import answers_of, count, flow, let_through
from .people_section import people_together
from .reliability import reliability
from .results_section import results
from .versions import versions


def describe(app: AppContext, request: Request) -> Report:
    """The report on the requested sessions.

    It does not contain its creation time, so that the same data gives the same report.
    """
    study = request.study
    digest = hashlib.sha256()
    for piece in csv_stream(app, TABLES["queries"], request):
        digest.update(piece)
    everybody = watched.sessions(app, study, request.modes)
    deleted = watched.deleted(app, study.id, request.modes)
    declined = decline_counter.total(app, study.id, request.modes)
    with app.database.read() as db:
        rests_on = answers_of(db, request)
        lines = [line for line in everybody if line.session_id in rests_on.sessions]
        passed = let_through(db, request)
        first = db.scalar(select(func.min(SessionRow.started_at)).where(*sessions_of(request)))
        last = db.scalar(select(func.max(SessionRow.last_seen_at)).where(*sessions_of(request)))
        facts = [
            ("Study", study.slug),
            ("Status", study.status),
            ("Opened", f"{study.opened_at:%Y-%m-%d %H:%M} UTC" if study.opened_at else "never"),
            ("Sessions", in_words(request)),
            ("First session", f"{first:%Y-%m-%d} UTC" if first else "no session yet"),
            ("Languages", _counted(db, request, SessionRow.language)),
            ("Recruited by", _counted(db, request, SessionRow.platform)),
            ("Data until", f"{last:%Y-%m-%d %H:%M} UTC" if last else "no session yet"),
        ]
        blocks: list[Block] = [
            Heading("Summary"),
            Table("What this report is about", ("Of", "Is"), facts),
            *design(db, study),
            orders_given(db, request),
            *flow(
                count(everybody, deleted, declined, passed, len(rests_on.sessions)),
                rests_on,
                lines,
                request,
            ),
            *results(db, request),
            *people_together(db, request),
            *reliability(db, request, lines),
            *versions(db, request, digest.hexdigest()),
        ]
    title = study.plan.text(study.plan.title, study.plan.default_language)
    return Report(title, f"Report of the study {study.slug}", blocks)


def _counted(db: Session, request: Request, column: InstrumentedAttribute[Any]) -> str:
    """The values of a session's column with their numbers of sessions: en 12, ja 3."""
    statement = (
        select(column, func.count(SessionRow.id))
        .where(*sessions_of(request))
        .group_by(column)
        .order_by(func.count(SessionRow.id).desc(), column)
    )
    said = [f"{value or 'a link of the study'} {number}" for value, number in db.execute(statement)]
    return ", ".join(said) or "no session"
