"""What an ethics board asks for: on a page, and as one zip."""

from __future__ import annotations

from itertools import groupby

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from app.services import sharing
from app.services.errors import NotFoundError
from app.services.ethics import bundle, fields, pictures

from .desk import DesignOf, OwnForm, SignedIn
from .privacy_sentences import sentences
from .screens import snapshots
from .security import StudioDep
from .study_frame import study_page
from .words import SOURCE_LANGUAGE

router = APIRouter(prefix="/studies/{slug}", include_in_schema=False)


@router.get("/ethics")
def ethics(study: DesignOf, request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    found = fields.fields(study.plan)
    return study_page(
        request,
        studio,
        caller,
        study,
        "ethics",
        texts=bundle.texts_of(studio, study),
        versions=bundle.versions(studio, study),
        stored=[(table, list(rows)) for table, rows in groupby(found, lambda field: field.table)],
        retention=study.plan.retention,
        keeps_identifiers=bool(study.plan.recruitment.parameters),
        told=sentences(studio, study.plan, SOURCE_LANGUAGE),
        expires_days=study.plan.session_expires_after_days,
        ties=sharing.ties(studio, study.slug),
        languages=study.plan.languages,
        has_browser=pictures.browser(studio.settings) is not None,
        made=bundle.made(studio, study),
        job=bundle.under_way(studio, caller, study),
    )


@router.post("/ethics/bundle", dependencies=[OwnForm])
def make(study: DesignOf, request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    """Ask for everything as one zip: texts, screens, stored fields, versions, plan."""
    pages = {
        f"{language}/{name}": html
        for language in study.plan.languages
        for name, html in snapshots(request, studio, study, language)
    }
    bundle.ask(studio, caller, study, pages)
    return RedirectResponse(f"/studies/{study.slug}/ethics", status_code=303)


@router.get("/ethics.zip")
def ethics_bundle(study: DesignOf, studio: StudioDep) -> Response:
    """The bundle that was made last."""
    made = bundle.made(studio, study)
    if made is None:
        raise NotFoundError("no ethics bundle of this study has been made yet")
    return FileResponse(
        made.path,
        media_type="application/zip",
        filename=f"{study.slug}-ethics.zip",
        headers={"Cache-Control": "no-store"},
    )
