"""The list of studies, and the page of one: how it stands, and what can be done with it."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services import access, drafts, results

from .desk import SignedIn, desk_page
from .security import StudioDep

router = APIRouter(include_in_schema=False)


@router.get("/studies")
def all_studies(request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    counts = results.counts(studio)
    nobody = results.Counts()
    lines = [
        {
            "slug": study.slug,
            "title": study.plan.text(study.plan.title, study.plan.default_language),
            "status": study.status,
            "sessions_live": counts.get((study.slug, "live"), nobody).total,
            "completed_live": counts.get((study.slug, "live"), nobody).completed,
            "created_at": study.created_at,
            "plan_hash": study.plan_hash,
        }
        for study in access.studies_for(studio, caller)
    ]
    return desk_page(
        request,
        caller,
        "experimenter/studies.html",
        "Studies",
        studies=lines,
        may_make=access.may_make_studies(caller),
        drafts=drafts.mine(studio, caller),
    )
