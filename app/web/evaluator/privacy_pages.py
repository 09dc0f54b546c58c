"""The privacy page: which data of an evaluator is stored, and for how long."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.runtime.errors import SessionExpiredError, SignInRequiredError
from app.services.sessions import advance
from app.services.sessions.state_view import State
from app.services.studies import repository
from app.web.http.security import AppDep
from app.web.http.translations import translatable
from app.web.http.wordings import wording_of

from .error_pages import EvaluatorRoute
from .privacy_sentences import sentences
from .session_pages import about, not_open, render, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)


@router.get("/privacy")
def privacy(slug: str, request: Request, app: AppDep) -> Response:
    """The page, in the language of the browser's session if there is one."""
    hidden = not_open(request, slug, app)
    if hidden is not None:
        return hidden
    plan = repository.find(app, slug).plan
    state = _state(slug, request, app)
    said = about(request, plan, state["language"] if state else None)
    return render(
        request,
        slug,
        "participant/privacy.html",
        translatable("Your privacy"),
        state,
        **said,
        plan=plan,
        sentences=sentences(app, plan, wording_of(app, slug, said["language"])),
    )


def _state(slug: str, request: Request, app: AppContext) -> State | None:
    try:
        return advance.current(app, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return None
