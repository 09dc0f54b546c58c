"""The list of studies, and the page of one: how it stands, and what can be done with it."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import RedirectResponse, Response

from app.services import access, admission, drafts, results, studies

from .desk import ChangeOf, DesignOf, OwnForm, SignedIn, desk_page
from .security import StudioDep, session_cookie, set_cookie
from .study_frame import study_page

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


@router.get("/studies/{slug}/plan")
def plan(study: DesignOf, request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    said = study.plan
    language = said.default_language
    return study_page(
        request,
        studio,
        caller,
        study,
        "plan",
        more={
            "plan_hash": study.plan_hash,
            "plan_version": study.plan_version,
            "conditions": [
                {
                    "name": condition.name,
                    "method": condition.method,
                    "environment": condition.environment,
                    "skip_label": condition.skip and said.text(condition.skip.label, language),
                }
                for condition in said.conditions
            ],
            "queries_per_trial": said.queries_per_trial,
            "trials": said.trials,
            "created_at": study.created_at,
            "opened_at": study.opened_at,
            "closed_at": study.closed_at,
            "payload_mb": results.payload_mb(studio, study),
        },
    )


@router.post("/studies/{slug}/open", dependencies=[OwnForm])
def open_study(study: ChangeOf, studio: StudioDep) -> Response:
    studies.open_study(studio, study.slug)
    return RedirectResponse(f"/studies/{study.slug}", status_code=303)


@router.post("/studies/{slug}/preview", dependencies=[OwnForm])
def preview(study: ChangeOf, studio: StudioDep) -> Response:
    """Go through the study as an evaluator would; its data is marked, and left out of results."""
    token, _ = admission.start(studio, study.slug, mode=admission.PREVIEW, by_experimenter=True)
    response = RedirectResponse(f"/s/{study.slug}", status_code=303)
    set_cookie(response, studio, session_cookie(study.slug), token)
    return response


@router.post("/studies/{slug}/close", dependencies=[OwnForm])
def close_study(study: ChangeOf, studio: StudioDep) -> Response:
    studies.close_study(studio, study.slug)
    return RedirectResponse(f"/studies/{study.slug}", status_code=303)
