"""The pages that an evaluator goes through: `/s/{slug}`, always the page of the stage one is in."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import admission, participation
from app.services.errors import (
    SessionExpiredError,
    SignInRequiredError,
    StudyNotOpenError,
)
from app.services.state import ENDED, State
from app.services.studio import Studio
from app.study.protocol import ProtocolError

from .security import SESSION_COOKIE_SECONDS, StudioDep, session_cookie, set_cookie
from .templating import page

router = APIRouter(prefix="/s/{slug}", include_in_schema=False)

#: Parameters of an address beyond these are not a platform's.
MAX_EXTERNAL_IDS = 20
MAX_KEY = 60
MAX_VALUE = 200

_TITLES = {
    "consent": "Consent",
    "instructions": "Instructions",
    "familiarisation": "Familiarisation",
    "query": "Which is better?",
    "break": "Break",
    "debrief": "Debrief",
    "completed": "Thank you",
    "withdrawn": "You have stopped",
    "declined": "You have declined",
}


@router.get("")
def enter(slug: str, request: Request, studio: StudioDep) -> Response:
    """The page of the stage that the browser's session is in; for a newcomer, the consent."""
    try:
        state = participation.current(studio, _token(request, slug))
    except SessionExpiredError:
        response = _page(request, slug, "participant/expired.html", "The session has expired")
        response.delete_cookie(session_cookie(slug))
        return response
    except SignInRequiredError:
        return _entrance(request, slug, studio)
    return _stage_page(request, slug, state)


@router.post("/consent")
def consent(
    slug: str, request: Request, studio: StudioDep, version: Annotated[str, Form()]
) -> Response:
    """Agree. Only now is anything kept of a newcomer."""
    token = request.cookies.get(session_cookie(slug))
    if token is None or not _is_known(studio, token):
        entrance = admission.entrance(studio, slug)
        if version != entrance.consent["version"]:
            return _to_stage(slug)
        token, _ = admission.start(
            studio, slug, external_ids=_external_ids(request), language=entrance.language
        )
    response = _do(slug, lambda: participation.consent(studio, token, version))
    set_cookie(response, studio, session_cookie(slug), token, max_age=SESSION_COOKIE_SECONDS)
    return response


@router.post("/decline")
def decline(slug: str, request: Request, studio: StudioDep) -> Response:
    """Decline. A newcomer leaves without a trace."""
    token = request.cookies.get(session_cookie(slug))
    if token is None or not _is_known(studio, token):
        return _page(request, slug, "participant/declined.html", _TITLES["declined"])
    return _do(slug, lambda: participation.withdraw(studio, token))


@router.post("/continue")
def go_on(slug: str, request: Request, studio: StudioDep) -> Response:
    return _do(slug, lambda: participation.go_on(studio, _token(request, slug)))


@router.get("/withdraw")
def ask_to_withdraw(slug: str, request: Request, studio: StudioDep) -> Response:
    """What stopping means, before one does."""
    try:
        state = participation.current(studio, _token(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return _to_stage(slug)
    if state["stage"] in ENDED:
        return _to_stage(slug)
    return _page(request, slug, "participant/withdraw.html", "Stop taking part?", state)


@router.post("/withdraw")
def withdraw(slug: str, request: Request, studio: StudioDep) -> Response:
    return _do(slug, lambda: participation.withdraw(studio, _token(request, slug)))


def _entrance(request: Request, slug: str, studio: Studio) -> Response:
    try:
        entrance = admission.entrance(studio, slug)
    except StudyNotOpenError as error:
        return _page(
            request, slug, "participant/closed.html", "Not open", message=str(error), status=409
        )
    state: State = {
        "stage": "consent",
        "progress": {
            "trial": 0,
            "trials": entrance.trials,
            "query": 0,
            "queries": entrance.queries,
        },
        "study": {"slug": slug, "title": entrance.title, "contact": entrance.contact},
        "language": entrance.language,
        "consent": dict(entrance.consent),
    }
    return _stage_page(request, slug, state)


def _stage_page(request: Request, slug: str, state: State) -> Response:
    stage = state["stage"]
    shown = state.get(stage) or {}
    return _page(
        request,
        slug,
        f"participant/{stage}.html",
        _TITLES[stage],
        state,
        html=shown.get("html", ""),
        version=shown.get("version", ""),
    )


def _page(
    request: Request,
    slug: str,
    template: str,
    title: str,
    state: State | None = None,
    *,
    status: int = 200,
    **context: Any,
) -> Response:
    study = state["study"] if state else {"title": None, "contact": None}
    query = request.url.query
    values = {
        "slug": slug,
        "base": f"/s/{slug}",
        "query_string": f"?{query}" if query else "",
        "state": state,
        "study_title": study["title"],
        "contact": study["contact"],
        "language": state["language"] if state else "en",
        "page_title": title,
        **context,
    }
    return page(request, template, values, status_code=status)


def _do(slug: str, action: Any) -> Response:
    """Do it, and show the stage the session is in then: also if it was out of order."""
    # A second click, another tab, the way back: the page of the stage says what is to be done.
    with suppress(ProtocolError, SignInRequiredError, SessionExpiredError):
        action()
    return _to_stage(slug)


def _to_stage(slug: str) -> Response:
    return RedirectResponse(f"/s/{slug}", status_code=303)


def _token(request: Request, slug: str) -> str:
    token = request.cookies.get(session_cookie(slug))
    if token is None:
        raise SignInRequiredError("this browser has no session of this study")
    return token


def _is_known(studio: Studio, token: str) -> bool:
    try:
        participation.current(studio, token)
    except (SignInRequiredError, SessionExpiredError):
        return False
    return True


def _external_ids(request: Request) -> dict[str, str]:
    pairs = list(request.query_params.items())[:MAX_EXTERNAL_IDS]
    return {key[:MAX_KEY]: value[:MAX_VALUE] for key, value in pairs if key and value}
