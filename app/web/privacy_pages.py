"""What is kept of an evaluator, and for how long: to be read on the way, and before one begins."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services import participation, studies
from app.services.errors import SessionExpiredError, SignInRequiredError
from app.services.state import State
from app.services.studio import Studio

from .failing_kindly import FailingKindly
from .privacy_sentences import sentences
from .security import StudioDep
from .session_pages import about, not_open, render, token_of
from .words import translatable

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=FailingKindly)


@router.get("/privacy")
def privacy(slug: str, request: Request, studio: StudioDep) -> Response:
    """The page, in the language of the browser's session if there is one."""
    hidden = not_open(request, slug, studio)
    if hidden is not None:
        return hidden
    plan = studies.find(studio, slug).plan
    state = _state(slug, request, studio)
    said = about(request, plan, state["language"] if state else None)
    return render(
        request,
        slug,
        "participant/privacy.html",
        translatable("Your privacy"),
        state,
        **said,
        plan=plan,
        sentences=sentences(studio, plan, said["language"]),
    )


def _state(slug: str, request: Request, studio: Studio) -> State | None:
    try:
        return participation.current(studio, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return None
