"""The list of studies."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.drafts import drafts
from app.services.monitoring import session_list
from app.services.studies import access
from app.web.http.security import AppDep

from .page_context import SignedIn, experimenter_page

router = APIRouter(include_in_schema=False)


@router.get("/studies")
def all_studies(request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The studies and drafts that the caller may see."""
    counts = session_list.counts(app)
    nobody = session_list.Counts()
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
        for study in access.studies_for(app, caller)
    ]
    return experimenter_page(
        request,
        caller,
        "experimenter/studies.html",
        "Studies",
        studies=lines,
        may_make=access.may_make_studies(caller),
        drafts=drafts.list_drafts(app, caller),
    )
