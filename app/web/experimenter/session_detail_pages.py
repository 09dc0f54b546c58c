"""The page of one session: its queries in order, and the posterior of each trial."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.monitoring.session_detail import session_detail
from app.services.results.trial_learning import LEARNING, find
from app.services.runtime.errors import NotFoundError
from app.web.http.security import AppDep

from .figure_files import Form, Theme, figure
from .page_context import DataOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/sessions/{session_id}")
def session(
    study: DataOf, session_id: str, request: Request, app: AppDep, caller: SignedIn
) -> Response:
    """The page of one session."""
    return study_page(
        request,
        app,
        caller,
        study,
        "session",
        story=session_detail(app, study, session_id),
    )


@router.get("/studies/{slug}/sessions/{session_id}/figures/{trial_index}/{name}.{form}")
def session_figure(
    study: DataOf,
    app: AppDep,
    session_id: str,
    trial_index: int,
    name: str,
    form: Form,
    theme: Theme = "light",
) -> Response:
    """One figure of a trial of the session."""
    if name not in LEARNING:
        raise NotFoundError(f"expected one of {', '.join(LEARNING)}, got {name!r}")
    found = find(app, study, session_id, trial_index, name)
    file = f"{study.slug}-{session_id}-trial-{trial_index + 1}-{name}"
    return figure(name, found, study, form, theme, file)
