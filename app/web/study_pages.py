"""The list of studies, and the page of one: how it stands, and what can be done with it."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services import access, drafts, results

from .desk import DesignOf, SignedIn, desk_page
from .security import StudioDep
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
