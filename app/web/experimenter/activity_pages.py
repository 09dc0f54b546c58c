"""Pages of the audit log: all of it, and that of one study."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.web.http.security import AppDep

from .page_context import Admin, DataOf, SignedIn, experimenter_page
from .study_frame import study_page

router = APIRouter(include_in_schema=False)

LINES = 100


@router.get("/activity")
def activity(request: Request, app: AppDep, caller: Admin, before: int | None = None) -> Response:
    """All entries, newest first."""
    return experimenter_page(
        request, caller, "experimenter/activity.html", "Activity", **_lines(app, None, before)
    )


@router.get("/studies/{slug}/activity")
def study_activity(
    study: DataOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    before: int | None = None,
) -> Response:
    """The entries of one study."""
    return study_page(request, app, caller, study, "activity", **_lines(app, study.slug, before))


def _lines(app: AppContext, slug: str | None, before: int | None) -> dict[str, Any]:
    found = audit_log.trail(app, slug, limit=LINES + 1, before=before)
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
    """A detail as text: lists with commas, mappings as pairs."""
    if isinstance(told, list):
        return ", ".join(map(_said, told))
    if isinstance(told, dict):
        return ", ".join(f"{key} {_said(inner)}" for key, inner in told.items())
    return "–" if told is None else str(told)
