"""The plan of a study: a summary, the full text, and every version."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import PlainTextResponse, Response

from app.services.monitoring import session_list
from app.services.studies import access, revision, simulation_results
from app.services.studies.access import Right
from app.study.markdown import render
from app.study.plan_summary import in_words
from app.study.plan_to_yaml import plan_text
from app.web.http.security import AppDep

from .page_context import DesignOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/plan")
def plan(study: DesignOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The page of the plan."""
    said = study.plan
    language = said.default_language
    return study_page(
        request,
        app,
        caller,
        study,
        "plan",
        more={
            "plan_hash": study.plan_hash,
            "conditions": [
                {
                    "name": condition.name,
                    "method": condition.method,
                    "environment": condition.environment,
                    "skip_label": condition.skip and said.text(condition.skip.label, language),
                    "is_off": condition.name in study.conditions_off,
                }
                for condition in said.conditions
            ],
            "parameters": [
                {
                    "name": parameter.name,
                    "label": parameter.label and said.text(parameter.label, language),
                    "unit": parameter.unit,
                }
                for parameter in said.parameters
            ],
            "created_at": study.created_at,
            "opened_at": study.opened_at,
            "closed_at": study.closed_at,
            "payload_mb": session_list.payload_mb(app, study),
        },
        sentences=in_words(said),
        duration=simulation_results.duration(app, study),
        versions=revision.versions(app, study),
        texts=[
            {"language": language, "name": name, "html": render(text)}
            for language, named in study.texts.items()
            for name, text in named.items()
        ],
    )


@router.get("/studies/{slug}/plan/study.yaml")
def download(study: DesignOf, app: AppDep, caller: SignedIn) -> Response:
    """The stored plan as a file: the hashed content without texts and videos.

    Callers without access to the study's data get it without completion codes.
    """
    text = f"# {study.slug}, version {study.plan_version}, hash {study.plan_hash}\n"
    with_codes = Right.DATA in access.rights(app, caller, study.slug)
    if not with_codes:
        text += "# Without completion codes and addresses to return to: they are for who runs it.\n"
    return PlainTextResponse(
        text + plan_text(study.plan, with_codes=with_codes),
        headers={
            "Content-Disposition": f'attachment; filename="{study.slug}-study.yaml"',
            "Cache-Control": "no-store",
        },
    )
