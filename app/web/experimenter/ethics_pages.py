"""The documents for an ethics board: a page, and one zip."""

from __future__ import annotations

from itertools import groupby

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from app.services.ethics import bundle, data_inventory, screenshots
from app.services.runtime.errors import NotFoundError
from app.services.studies import sharing
from app.web.evaluator.page_samples import snapshots
from app.web.evaluator.privacy_sentences import sentences
from app.web.http.security import AppDep
from app.web.http.translations import Wording

from .page_context import DesignOf, OwnForm, SignedIn
from .study_frame import study_page

router = APIRouter(prefix="/studies/{slug}", include_in_schema=False)


@router.get("/ethics")
def ethics(study: DesignOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The page with the stored data, the texts and the latest bundle."""
    found = data_inventory.fields(study.plan)
    return study_page(
        request,
        app,
        caller,
        study,
        "ethics",
        texts=bundle.texts_of(app, study),
        versions=bundle.versions(app, study),
        stored=[(table, list(rows)) for table, rows in groupby(found, lambda field: field.table)],
        retention=study.plan.retention,
        has_machines=any(
            one.is_machine and not one.is_crane_machine for one in study.plan.environments.values()
        ),
        keeps_identifiers=bool(study.plan.recruitment.link_parameters),
        told=sentences(app, study.plan, Wording()),
        expires_days=study.plan.session_expires_after_days,
        ties=sharing.members(app, study.slug),
        languages=study.plan.languages,
        has_browser=screenshots.browser(app.settings) is not None,
        made=bundle.finished_bundle(app, study),
        job=bundle.under_way(app, caller, study),
    )


@router.post("/ethics/bundle", dependencies=[OwnForm])
def make(study: DesignOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Start the job that makes the zip: texts, screens, stored fields, versions, plan."""
    pages = {
        f"{language}/{name}": html
        for language in study.plan.languages
        for name, html in snapshots(request, app, study, language)
    }
    bundle.request_bundle(app, caller, study, pages)
    return RedirectResponse(f"/studies/{study.slug}/ethics", status_code=303)


@router.get("/ethics.zip")
def ethics_bundle(study: DesignOf, app: AppDep) -> Response:
    """The latest bundle."""
    made = bundle.finished_bundle(app, study)
    if made is None:
        raise NotFoundError("no ethics bundle of this study has been made yet")
    return FileResponse(
        made.path,
        media_type="application/zip",
        filename=f"{study.slug}-ethics.zip",
        headers={"Cache-Control": "no-store"},
    )
