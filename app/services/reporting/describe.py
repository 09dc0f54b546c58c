"""The report of a study as one description, from which HTML and PDF are written."""

from __future__ import annotations

import hashlib

from sqlalchemy import func, select

from app.services import declining
from app.services import results as watched
from app.services.export.columns import Request, sessions_of
from app.services.export.filters import in_words
from app.services.export.stream import csv_stream
from app.services.export.tables import TABLES
from app.services.studio import Studio
from app.storage.tables import SessionRow

from .blocks import Block, Heading, Report, Table
from .design import design
from .flow import answers_of, count, flow, let_through
from .outcome import results
from .reliability import reliability
from .versions import versions


def describe(studio: Studio, request: Request) -> Report:
    """The sessions that are asked for, reported. It says nothing of when it was made: the same
    data gives the same report."""
    study = request.study
    digest = hashlib.sha256()
    for piece in csv_stream(studio, TABLES["queries"], request):
        digest.update(piece)
    everybody = watched.sessions(studio, study, request.modes)
    deleted = watched.deleted(studio, study.id, request.modes)
    declined = declining.counted(studio, study.id, request.modes)
    with studio.database.read() as session:
        rests_on = answers_of(session, request)
        lines = [line for line in everybody if line.session_id in rests_on.sessions]
        passed = let_through(session, request)
        last = session.scalar(
            select(func.max(SessionRow.last_seen_at)).where(*sessions_of(request))
        )
        facts = [
            ("Study", study.slug),
            ("Status", study.status),
            ("Opened", f"{study.opened_at:%Y-%m-%d %H:%M} UTC" if study.opened_at else "never"),
            ("Sessions", in_words(request)),
            ("Data until", f"{last:%Y-%m-%d %H:%M} UTC" if last else "nobody came yet"),
        ]
        blocks: list[Block] = [
            Heading("Summary"),
            Table("What this report is about", ("Of", "Is"), facts),
            *design(session, study),
            *flow(
                count(everybody, deleted, declined, passed, len(rests_on.sessions)),
                rests_on,
                lines,
                request,
            ),
            *results(session, request),
            *reliability(session, request, lines),
            *versions(session, request, digest.hexdigest()),
        ]
    title = study.plan.text(study.plan.title, study.plan.default_language)
    return Report(title, f"Report of the study {study.slug}", blocks)
