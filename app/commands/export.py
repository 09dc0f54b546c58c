"""`pbpo export` and `pbpo report`: a study's data as files, and what they come to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from app.services import export as exports
from app.services.accounts.audit_log import COMMAND_LINE
from app.services.context import AppContext
from app.services.export import FORMATS, TABLES, person
from app.services.runtime.errors import PdfError, ServiceError
from app.services.sessions import participants
from app.services.studies import repository

from .filters import Filters, with_filters
from .options import DataDir, Slug, app_context_of, out

Out = Annotated[Path, typer.Option("--out", help="Folder to write to.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Write over files that hold something else.")
]


@with_filters
def export(
    slug: Slug,
    out_dir: Out,
    filters: Filters,
    format: Annotated[  # noqa: A002 - the option's name
        str, typer.Option(help=", ".join(FORMATS))
    ] = "csv",
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
        if filters.are_given or table or format != "csv":
            raise ServiceError("expected --participant without other choices, got some")
        _write_person(app, slug, participant, out_dir, overwrite, excel)
        return
    request = filters.request(app, slug)
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


@with_filters
def report(
    slug: Slug,
    out_dir: Out,
    filters: Filters,
    overwrite: Overwrite = False,
    data_dir: DataDir = None,
) -> None:
    """Write a study's report, report.html and report.pdf: design, flow, results, versions."""
    from app.services import reporting  # noqa: PLC0415 - figures are slow to load

    app = app_context_of(data_dir)
    request = filters.request(app, slug)
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
