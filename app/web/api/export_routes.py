"""An experimenter's exports, streamed, and noted in the audit trail when they end."""

from __future__ import annotations

from collections.abc import Generator
from datetime import date
from typing import Annotated, Any, Literal

import anyio
from fastapi import APIRouter, Depends, Path, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.services import export, reporting
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.export import TABLES, Request, person
from app.services.monitoring.data_quality import Flag
from app.services.runtime.errors import NotFoundError
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo
from app.web.http.head_requests import IS_HEAD, headers_alone
from app.web.http.problems import refusals
from app.web.http.security import POLICY, AppDep, ExperimenterDep

from .token_schemes import EXPERIMENTER, short_id

router = APIRouter(
    prefix="/api/v1/studies/{slug}",
    tags=["export"],
    dependencies=[Depends(EXPERIMENTER)],
    generate_unique_id_function=short_id,
)

Mode = Literal["live", "preview", "pilot", "simulated", "all"]
ReportForm = Literal["html", "pdf"]
FormatName = Literal["csv", "psych-ds", "botorch", "optuna"]
#: A form sends a day that was not filled in as an empty text.
Day = date | Literal[""] | None


class Filter:
    """Which sessions and trials count, as a query says it."""

    def __init__(
        self,
        mode: Annotated[
            list[Mode] | None, Query(description="Which sessions count. Default: live.")
        ] = None,
        condition: Annotated[
            list[str] | None, Query(description="Only trials under these conditions.")
        ] = None,
        since: Annotated[
            Day, Query(alias="from", description="First day, in UTC, of the sessions' beginning.")
        ] = None,
        until: Annotated[Day, Query(alias="to", description="Last day of the same.")] = None,
        exclude_flag: Annotated[
            list[Flag] | None, Query(description="Leave sessions with such a flag out.")
        ] = None,
        exclude_flagged: Annotated[
            bool, Query(description="Leave sessions with any flag out.")
        ] = False,
        completed: Annotated[bool, Query(description="Only completed sessions.")] = False,
        excel: Annotated[
            bool, Query(description="Begin tables with a byte order mark, as Excel wants it.")
        ] = False,
    ) -> None:
        self.modes = export.modes_of(mode)
        self.conditions = tuple(dict.fromkeys(condition or ()))
        self.since, self.until = since or None, until or None
        self.without = export.ALL_FLAGS if exclude_flagged else tuple(exclude_flag or ())
        self.completed = completed
        self.excel = excel

    def of(self, app: AppContext, study: StudyInfo) -> Request:
        """What is asked of this study. Raises ConflictError."""
        asked = Request(
            study,
            self.modes,
            self.conditions,
            self.since,
            self.until,
            self.without,
            self.completed,
            excel=self.excel,
        )
        return export.resolve_flags(app, asked)


FilterDep = Annotated[Filter, Depends()]


def _answers(content: dict[str, dict[str, str]]) -> dict[int | str, dict[str, Any]]:
    """What an export may be answered with: a file of one of these types, or a refusal."""
    types = {media_type: {"schema": schema} for media_type, schema in content.items()}
    return {
        200: {"description": "The file, streamed.", "content": types},
        **refusals(401, 403, 404, 409),
    }


_BINARY = {"type": "string", "format": "binary"}
_TEXT = {"type": "string"}


@router.get(
    "/export.zip",
    response_class=StreamingResponse,
    responses=_answers({"application/zip": _BINARY}),
)
def export_zip(
    slug: str,
    app: AppDep,
    caller: ExperimenterDep,
    asked: FilterDep,
    format: Annotated[  # noqa: A002 - the query's name
        FormatName, Query(description="What the zip holds. Never identities.")
    ] = "csv",
) -> StreamingResponse:
    """A study's data in one zip."""
    study = access.study_for(app, caller, slug, Right.DATA)
    return zip_response(app, caller, asked.of(app, study), format)


@router.get(
    "/export/{table}.csv",
    response_class=StreamingResponse,
    responses=_answers({"text/csv": _TEXT}),
)
def export_table(
    slug: str,
    table: Annotated[str, Path(json_schema_extra={"enum": list(TABLES)})],
    app: AppDep,
    caller: ExperimenterDep,
    asked: FilterDep,
) -> StreamingResponse:
    """One table as CSV."""
    right = Right.IDENTITIES if table == "identities" else Right.DATA
    request = asked.of(app, access.study_for(app, caller, slug, right))
    if table not in TABLES:
        raise NotFoundError(f"expected one of {', '.join(TABLES)}, got {table!r}")
    return Download(
        export.recorded(
            app,
            caller.email,
            request,
            "identities" if table == "identities" else "csv",
            f"{table}.csv",
            export.csv_stream(app, TABLES[table], request),
        ),
        f"{slug}-{table}.csv",
        "text/csv; charset=utf-8",
    )


@router.get(
    "/report.{form}",
    response_class=StreamingResponse,
    responses=_answers({"text/html": _TEXT, "application/pdf": _BINARY}),
)
def report(
    slug: str, form: ReportForm, app: AppDep, caller: ExperimenterDep, asked: FilterDep
) -> StreamingResponse:
    """What the data comes to: design, flow of participants, results with tests, versions."""
    study = access.study_for(app, caller, slug, Right.DATA)
    return report_response(app, caller, asked.of(app, study), form)


def report_response(
    app: AppContext, caller: Principal, request: Request, form: ReportForm
) -> StreamingResponse:
    """The report, to be kept: a browser that shows it lets it run nothing."""
    described = reporting.describe(app, request)
    made = reporting.html(described) if form == "html" else reporting.pdf(described)
    name = f"{request.study.slug}-report.{form}"
    response = Download(
        export.recorded(app, caller.email, request, "report", name, [made]),
        name,
        "text/html; charset=utf-8" if form == "html" else "application/pdf",
    )
    response.headers[POLICY] = f"sandbox; {reporting.POLICY}"
    return response


def zip_response(
    app: AppContext, caller: Principal, request: Request, form: str
) -> StreamingResponse:
    """The data in one of the formats. Raises ConflictError where it cannot be made here."""
    files = export.find(form).files(request)
    slug = request.study.slug
    name = f"{slug}.zip" if form == "csv" else f"{slug}-{form}.zip"
    pieces = export.zip_stream(app, files)
    return Download(
        export.recorded(app, caller.email, request, form, name, pieces),
        name,
        "application/zip",
    )


def person_response(
    app: AppContext, caller: Principal, study: StudyInfo, pseudonym: str
) -> StreamingResponse:
    """All that is stored of one participant, in one zip."""
    request = person.request_of(study, [pseudonym])
    pieces = export.zip_stream(app, person.files(request))
    return Download(
        # The name in the trail holds no pseudonym, since the trail outlives a deletion.
        export.recorded(app, caller.email, request, export.PERSON, "person.zip", pieces),
        f"{study.slug}-{pseudonym}.zip",
        "application/zip",
    )


class Download(StreamingResponse):
    """A file on its way to its reader; its pieces are told when the reader is gone."""

    def __init__(self, pieces: Generator[bytes], name: str, media_type: str) -> None:
        super().__init__(
            pieces,
            media_type=media_type,
            headers={
                "Content-Disposition": f'attachment; filename="{name}"',
                "Cache-Control": "no-store",
            },
        )
        self._pieces = pieces

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            if scope.get(IS_HEAD):
                # Nothing is read, so nothing is exported and noted.
                await headers_alone(self.headers)(scope, receive, send)
            else:
                await super().__call__(scope, receive, send)
        finally:
            with anyio.CancelScope(shield=True):
                await run_in_threadpool(self._pieces.close)
