"""The page of a study's results across sessions, and its figures."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.export.table import Request as Wanted
from app.services.monitoring.overview import modes_of
from app.services.results.registry import FINDINGS, find
from app.services.runtime.errors import NotFoundError
from app.web.http.security import AppDep

from .figure_files import Form, Theme, figure
from .overview_pages import mode_of
from .page_context import DataOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/results")
def results(
    study: DataOf, request: Request, app: AppDep, caller: SignedIn, mode: str = "live"
) -> Response:
    """The page of results."""
    mode = mode_of(mode)
    figures = [
        {
            "name": name,
            "title": finding.title,
            "about": finding.about,
            "url": f"/studies/{study.slug}/figures/{name}",
            "query": f"?mode={mode}",
        }
        for name, finding in FINDINGS.items()
    ]
    return study_page(request, app, caller, study, "results", mode=mode, figures=figures)


@router.get("/studies/{slug}/figures/{name}.{form}")
def results_figure(
    study: DataOf,
    app: AppDep,
    name: str,
    form: Form,
    mode: str = "live",
    theme: Theme = "light",
) -> Response:
    """One figure of the results page."""
    if name not in FINDINGS:
        raise NotFoundError(f"expected one of {', '.join(FINDINGS)}, got {name!r}")
    mode = mode_of(mode)
    found = find(app, Wanted(study, modes_of(mode)), name)
    marked = "" if mode == "live" else f"-{mode}"
    return figure(name, found, study, form, theme, f"{study.slug}-{name}{marked}")
