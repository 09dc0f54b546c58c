"""The plan of a study: in words, in full, and each version that it has had."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import PlainTextResponse, Response

from app.services import access, design, results, revision
from app.services.access import Right
from app.study.plan_text import plan_text
from app.study.plan_words import in_words
from app.study.texts import render

from .desk import DesignOf, SignedIn
from .security import StudioDep
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


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
            "payload_mb": results.payload_mb(studio, study),
        },
        sentences=in_words(said),
        duration=design.duration(studio, study),
        versions=revision.versions(studio, study),
        texts=[
            {"language": language, "name": name, "html": render(text)}
            for language, named in study.texts.items()
            for name, text in named.items()
        ],
    )


@router.get("/studies/{slug}/plan/study.yaml")
def download(study: DesignOf, studio: StudioDep, caller: SignedIn) -> Response:
    """The stored plan as a file: what the hash is of, but for texts and videos.

    Who may not see the study's data gets it without the codes by which people are paid.
    """
    text = f"# {study.slug}, version {study.plan_version}, hash {study.plan_hash}\n"
    with_codes = Right.DATA in access.rights(studio, caller, study.slug)
    if not with_codes:
        text += "# Without completion codes and addresses to return to: they are for who runs it.\n"
    return PlainTextResponse(
        text + plan_text(study.plan, with_codes=with_codes),
        headers={
            "Content-Disposition": f'attachment; filename="{study.slug}-study.yaml"',
            "Cache-Control": "no-store",
        },
    )
