"""The audit trail, to be read: of everything, and of one study."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services import audit
from app.services.studio import Studio

from .desk import Admin, DataOf, SignedIn, desk_page
from .security import StudioDep
from .study_frame import study_page

router = APIRouter(include_in_schema=False)

LINES = 100


@router.get("/activity")
def activity(
    request: Request, studio: StudioDep, caller: Admin, before: int | None = None
) -> Response:
    """All that was done, the newest first."""
    return desk_page(
        request, caller, "experimenter/activity.html", "Activity", **_lines(studio, None, before)
    )


@router.get("/studies/{slug}/activity")
def study_activity(
    study: DataOf,
    request: Request,
    studio: StudioDep,
    caller: SignedIn,
    before: int | None = None,
) -> Response:
    """What was done with one study."""
    return study_page(
        request, studio, caller, study, "activity", **_lines(studio, study.slug, before)
    )


def _lines(studio: Studio, slug: str | None, before: int | None) -> dict[str, Any]:
    found = audit.trail(studio, slug, limit=LINES + 1, before=before)
    return {
        "lines": [
            {
                "at": line.happened_at,
                "actor": line.actor,
                "action": line.action,
                "study": line.study_slug,
                "details": "; ".join(f"{key}: {_said(told)}" for key, told in line.details.items()),
            }
            for line in found[:LINES]
        ],
        "older": found[LINES - 1].id if len(found) > LINES else None,
        "is_first": before is None,
    }


def _said(told: Any) -> str:
    """A detail for people: lists with commas between, mappings as pairs."""
    if isinstance(told, list):
        return ", ".join(map(_said, told))
    if isinstance(told, dict):
        return ", ".join(f"{key} {_said(inner)}" for key, inner in told.items())
    return "–" if told is None else str(told)
