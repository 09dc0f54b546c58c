"""`pbpo export` and `pbpo report`: a study's data as files, and what they come to."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.services import export as exports
from app.services.accounts.audit_log import COMMAND_LINE
from app.services.context import AppContext
from app.services.export import FORMATS, TABLES, Request, person
from app.services.monitoring.data_quality import Flag
from app.services.runtime.errors import PdfError, ServiceError
from app.services.sessions import participants
from app.services.studies import repository

from .options import DataDir, Slug, app_context_of, out


class Mode(StrEnum):
    live = "live"
    preview = "preview"
    pilot = "pilot"
    simulated = "simulated"
    all = "all"


Out = Annotated[Path, typer.Option("--out", help="Folder to write to.")]
Modes = Annotated[
    list[Mode] | None,
    typer.Option("--mode", help="Which sessions count; may be repeated. Default: live."),
]
Conditions = Annotated[
    list[str] | None,
    typer.Option("--condition", help="Only trials under this condition; may be repeated."),
]
From = Annotated[
    datetime | None,
    typer.Option(
        "--from", formats=["%Y-%m-%d"], help="First day, in UTC, on which sessions began."
    ),
]
To = Annotated[
    datetime | None,
    typer.Option("--to", formats=["%Y-%m-%d"], help="Last day on which sessions began."),
]
WithoutFlagged = Annotated[
    bool, typer.Option("--exclude-flagged", help="Leave sessions with any quality flag out.")
]
WithoutFlags = Annotated[
    list[Flag] | None,
    typer.Option("--exclude-flag", help="Leave sessions with this flag out; may be repeated."),
]
Completed = Annotated[bool, typer.Option("--completed", help="Only completed sessions.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Write over files that hold something else.")
]


def asked(
    app: AppContext,
    slug: str,
    mode: list[Mode] | None,
    condition: list[str] | None,
    since: datetime | None,
    until: datetime | None,
    exclude_flagged: bool,
    exclude_flag: list[Flag] | None,
    completed: bool,
) -> Request:
    """What the options ask for. Raises ServiceError."""
    return exports.resolve_flags(
        app,
        Request(
            repository.find(app, slug),
            exports.modes_of([str(chosen) for chosen in mode or ()]),
            tuple(dict.fromkeys(condition or ())),
            _day(since),
            _day(until),
            exports.ALL_FLAGS if exclude_flagged else tuple(exclude_flag or ()),
            completed,
        ),
    )


def export(
    slug: Slug,
    out_dir: Out,
    format: Annotated[  # noqa: A002 - the option's name
        str, typer.Option(help=", ".join(FORMATS))
    ] = "csv",
    mode: Modes = None,
    condition: Conditions = None,
    since: From = None,
    until: To = None,
    exclude_flagged: WithoutFlagged = False,
    exclude_flag: WithoutFlags = None,
    completed: Completed = False,
    table: Annotated[
        list[str] | None,
        typer.Option(help="Of csv, only these tables; identities only so."),
    ] = None,
    excel: Annotated[
        bool, typer.Option("--excel", help="Begin tables with a byte order mark, for Excel.")
    ] = False,
    participant: Annotated[
        str | None,
        typer.Option(
            help="Everything of one person, found by pseudonym, receipt code or platform id."
        ),
    ] = None,
    overwrite: Overwrite = False,
    data_dir: DataDir = None,
) -> None:
    """Write a study's data into a folder; what was exported is noted, with its SHA-256."""
    form = exports.find(format)
    unknown = [name for name in table or [] if name not in TABLES]
    if unknown:
        raise ServiceError(f"expected tables among {', '.join(TABLES)}, got {unknown[0]!r}")
    if table and format != "csv":
        raise ServiceError(f"expected --table with --format csv, got --format {format}")
    app = app_context_of(data_dir)
    if participant is not None:
        filters = (mode, condition, since, until, exclude_flagged, exclude_flag, completed, table)
        if any(filters) or format != "csv":
            raise ServiceError("expected --participant without other choices, got some")
        _write_person(app, slug, participant, out_dir, overwrite, excel)
        return
    request = asked(
        app, slug, mode, condition, since, until, exclude_flagged, exclude_flag, completed
    )
    request = replace(request, excel=excel)
    named = [name for name in dict.fromkeys(table or ()) if name != "identities"]
    parts = {format: form.files(request)} if not table else {}
    if named:
        parts[format] = [exports.table_file(TABLES[name], request) for name in named]
    if "identities" in (table or ()):
        # Apart from the others: looking at who somebody is is noted as what it is.
        parts["identities"] = [exports.table_file(TABLES["identities"], request)]
    for name, files in parts.items():
        for path in exports.write_folder(
            app, COMMAND_LINE, request, name, files, out_dir, overwrite=overwrite
        ):
            out.print(str(path))


def _write_person(
    app: AppContext, slug: str, participant: str, out_dir: Path, overwrite: bool, excel: bool
) -> None:
    study = repository.find(app, slug)
    found = participants.find_by_any(app, slug, study.id, participant)
    pseudonyms = [one.pseudonym for one in found]
    request = replace(person.request_of(study, pseudonyms), excel=excel)
    for path in exports.write_folder(
        app,
        COMMAND_LINE,
        request,
        exports.PERSON,
        person.files(request),
        out_dir,
        overwrite=overwrite,
    ):
        out.print(str(path))


def report(
    slug: Slug,
    out_dir: Out,
    mode: Modes = None,
    condition: Conditions = None,
    since: From = None,
    until: To = None,
    exclude_flagged: WithoutFlagged = False,
    exclude_flag: WithoutFlags = None,
    completed: Completed = False,
    overwrite: Overwrite = False,
    data_dir: DataDir = None,
) -> None:
    """Write a study's report, report.html and report.pdf: design, flow, results, versions."""
    from app.services import reporting  # noqa: PLC0415 - figures are slow to load

    app = app_context_of(data_dir)
    request = asked(
        app, slug, mode, condition, since, until, exclude_flagged, exclude_flag, completed
    )
    described = reporting.describe(app, request)
    files = [exports.File("report.html", lambda _session: [reporting.html(described)])]
    fault: PdfError | None = None
    try:
        made = reporting.pdf(described)
        files.append(exports.File("report.pdf", lambda _session: [made]))
    except PdfError as error:
        fault = error
    for path in exports.write_folder(
        app, COMMAND_LINE, request, "report", files, out_dir, overwrite=overwrite
    ):
        out.print(str(path))
    if fault is not None:
        raise fault


def _day(moment: datetime | None) -> date | None:
    return moment and moment.date()
