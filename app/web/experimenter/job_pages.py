"""Progress of a job as JSON, for pages."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from app.services import jobs
from app.web.http.security import AppDep

from .page_context import SignedIn

router = APIRouter(include_in_schema=False)


@router.get("/jobs/{public_id}")
def look(public_id: str, app: AppDep, caller: SignedIn) -> dict[str, Any]:
    """The status and progress of a job."""
    info = jobs.status(app, caller, public_id)
    return {
        "state": info.state,
        "done": info.done,
        "total": info.total,
        "message": info.message,
        "is_over": info.is_over,
    }
