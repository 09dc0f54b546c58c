"""The page of a study's data: selection, download, and the list of earlier exports."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from app.services import export
from app.services.accounts import audit_log
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.export import FORMATS, TABLES
from app.services.monitoring.data_quality import LABELS
from app.services.runtime.errors import ConflictError
from app.services.studies.repository import StudyInfo
from app.web.api.export_routes import (
    FilterDep,
    FormatName,
    ReportForm,
    report_response,
    zip_response,
)
from app.web.http.security import AppDep

from .page_context import DataOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)

#: How many of the last exports the page lists.
LISTED = 50


@router.get("/studies/{slug}/data")
def data(study: DataOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The form of exports, and the latest exports."""
    return _page(request, app, caller, study)


@router.get("/studies/{slug}/data/download")
def download(
    study: DataOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    asked: FilterDep,
    form: Annotated[FormatName, Query(alias="format")] = "csv",
) -> Response:
    """The export selected in the form."""
    try:
        return zip_response(app, caller, asked.of(app, study), form)
    except ConflictError as error:
        return _page(request, app, caller, study, str(error))


@router.get("/studies/{slug}/data/report.{form}")
def report(
    study: DataOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    asked: FilterDep,
    form: ReportForm,
    _of_the_form: Annotated[FormatName, Query(alias="format")] = "csv",
) -> Response:
    """The report on the data selected in the form, which has a format for the tables, too."""
    try:
        return report_response(app, caller, asked.of(app, study), form)
    except ConflictError as error:
        return _page(request, app, caller, study, str(error))


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    refused: str | None = None,
) -> Response:
    lines = audit_log.trail(app, study.slug, export.ACTIONS, limit=LISTED)
    return study_page(
        request,
        app,
        caller,
        study,
        "data",
        status_code=409 if refused else 200,
        more={"conditions": [condition.name for condition in study.plan.conditions]},
        refused=refused,
        formats=FORMATS.values(),
        flags=[(flag.value, label) for flag, label in LABELS.items()],
        tables=[
            {
                "name": table.name,
                "description": table.description,
                "url": f"/api/v1/studies/{study.slug}/export/{table.name}.csv",
            }
            for table in TABLES.values()
        ],
        exports=[_export(line) for line in lines],
    )


def _export(line: audit_log.AuditLine) -> dict[str, Any]:
    return {
        "at": line.happened_at,
        "actor": line.actor,
        "action": line.action,
        "format": line.details.get("format", ""),
        "filter": line.details.get("filter", ""),
        "files": line.details.get("files", {}),
        "incomplete": line.details.get("incomplete"),
    }
