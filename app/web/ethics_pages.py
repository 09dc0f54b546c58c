"""What an ethics board asks for: on a page, and as one zip."""

from __future__ import annotations

from itertools import groupby

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services import audit, sharing
from app.services.ethics import bundle, fields, pictures

from .desk import DesignOf, SignedIn
from .screens import is_long, snapshots
from .security import StudioDep
from .study_frame import study_page

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
        expires_days=study.plan.session_expires_after_days,
        ties=sharing.ties(studio, study.slug),
        languages=study.plan.languages,
        has_browser=pictures.browser(studio) is not None,
    )


@router.get("/ethics.zip")
def ethics_bundle(
    study: DesignOf, request: Request, studio: StudioDep, caller: SignedIn
) -> Response:
    """Everything at a press: texts, screens, stored fields, versions, plan."""
    files = bundle.documents(studio, study)
    for language in study.plan.languages:
        for name, html in snapshots(request, studio, study, language):
            files[f"screens/{language}/{name}.html"] = html.encode()
            picture = pictures.picture_of(studio, html, is_long=is_long(html))
            if picture is not None:
                files[f"screens/{language}/{name}.png"] = picture
    audit.note_alone(studio, caller.email, "ethics bundle made", study.slug, files=len(files))
    return Response(
        bundle.zipped(files),
        media_type="application/zip",
        headers={
            "Content-Disposition": f'attachment; filename="{study.slug}-ethics.zip"',
            "Cache-Control": "no-store",
        },
    )
