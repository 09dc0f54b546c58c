"""Pages for people whose browser, network or screen keeps them from taking part.

Each says what it is, what helps, whom to ask, and has the platform's code for technical failures.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.runtime.errors import SessionExpiredError, SignInRequiredError
from app.services.sessions import advance, failure_return
from app.services.sessions.state_view import ENDED
from app.services.studies import repository, session_modes
from app.web.http import session_paths
from app.web.http.security import AppDep, session_cookie
from app.web.http.translations import translatable

from .error_pages import EvaluatorRoute
from .session_pages import about, not_open, render, to_stage, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)


class Trouble(StrEnum):
    """A reason why a person cannot take part."""

    VIDEOS = "videos"
    BROWSER = "browser"
    SCREEN = "screen"


TITLES = {
    Trouble.VIDEOS: translatable("The videos do not load"),
    Trouble.BROWSER: translatable("This browser cannot show the study"),
    Trouble.SCREEN: translatable("The page is too small"),
}


@router.get("/trouble/{what}")
def trouble(slug: str, what: Trouble, request: Request, app: AppDep) -> Response:
    """What helps, and the way back. The session stays where it is."""
    hidden = not_open(request, slug, app)
    if hidden is not None:
        return hidden
    values = _of_reader(request, slug, app)
    if values is None:
        return to_stage(slug)
    way_back = None
    if session_paths.mode_of(request) == session_modes.LIVE:
        token = request.cookies.get(session_cookie(slug))
        way_back = failure_return.after_a_failure(app, slug, token)
    return render(
        request,
        slug,
        "participant/trouble.html",
        TITLES[what],
        what=what.value,
        way_back=way_back,
        **values,
    )


def _of_reader(request: Request, slug: str, app: AppContext) -> dict[str, Any] | None:
    """Values of the page: of the reader's session, or of the study; None if the session ended."""
    try:
        state = advance.current(app, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return about(request, repository.find(app, slug).plan)
    return None if state["stage"] in ENDED else {"state": state}
