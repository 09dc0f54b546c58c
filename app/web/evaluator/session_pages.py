"""Shared by the pages of a session: the browser's session, and rendering."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from fastapi import Request
from fastapi.responses import RedirectResponse, Response
from sqlalchemy.exc import SQLAlchemyError

from app.services.context import AppContext
from app.services.runtime.errors import NotFoundError, SessionExpiredError, SignInRequiredError
from app.services.sessions import advance, receipts
from app.services.sessions.state_view import ENDED, State
from app.services.studies import repository, session_modes, video_formats
from app.study.page_words import own_name
from app.study.plan import Plan
from app.study.recruitment import MTURK_FRAMES, MTURK_HOSTS
from app.study.stages import ProtocolError
from app.web.http import languages, session_paths, translations
from app.web.http.public_address import base_url
from app.web.http.security import (
    POLICY,
    app_context_of,
    content_security_policy,
    form_token,
    session_cookie,
)
from app.web.http.templating import page
from app.web.http.translations import translatable
from app.web.http.wordings import readers_wording, wording_of

from . import hidden_drafts, session_cookies

#: Pages of a draft that `not_open` stands before; the ethics bundle shows them also of a draft.
_GUARDED = frozenset({"participant/privacy.html", "participant/delete.html"})
#: The first pages, which say what a browser lacks.
_FIRST = frozenset({"participant/welcome.html", "participant/consent.html"})
#: The stages whose pages show the receipt code.
_WITH_RECEIPT = frozenset({"instructions", "debrief", "completed", "screened_out", "withdrawn"})


def render(
    request: Request,
    slug: str,
    template: str,
    title: str,
    state: State | None = None,
    *,
    status: int = 200,
    **context: Any,
) -> Response:
    """A page of this study; `context` has the values of this page only.

    title: in English; without a state and a language in `context`, the reader's language is used.
    """
    study = state["study"] if state else {"title": None, "contact": None}
    query = request.url.query
    token = request.cookies.get(session_cookie(slug))
    app = app_context_of(request)
    language = state["language"] if state else context.get("language")
    wording = wording_of(app, slug, language) if language else readers_wording(request, app, slug)
    values = {
        "slug": session_paths.study_header(request, slug),
        "base": session_paths.base_of(request, slug),
        **_banner(request, slug),
        "query_string": f"?{query}" if query else "",
        "state": state,
        "study_title": study["title"],
        "contact": study["contact"],
        "language": wording.language,
        "wording": wording,
        "page_title": translations.translated(title, wording),
        "delete_url": f"{base_url(request)}/s/{slug}/delete",
        "receipt": _receipt(request, slug, state),
        "is_held": state is not None and token is not None,
        **context,
    }
    if template in _FIRST:
        values["video_formats"] = video_formats.of(app, slug)
    if values["study_title"] and state is None and template not in _GUARDED:
        with suppress(NotFoundError, SQLAlchemyError):
            # A page that says that the study is not open does not say what it is about.
            if hidden_drafts.is_hidden(request, slug, app):
                values |= {"study_title": None, "contact": None}
                values["page_title"] = translations.translated(translatable("Not open"), wording)
    response = page(request, template, values, status_code=status)
    way_back = context.get("way_back")
    if way_back is not None and "fields" in way_back:
        # The one form that leaves our pages: to Mechanical Turk, which redirects within itself.
        hosts = [f"https://{host}" for host in MTURK_HOSTS]
        response.headers[POLICY] = content_security_policy(
            app_context_of(request).recordings.origin, form_action=(*hosts, *MTURK_FRAMES)
        )
    return response


def _banner(request: Request, slug: str) -> dict[str, Any]:
    """The banner on pages of sessions that do not count."""
    mode = session_paths.mode_of(request)
    if mode == session_modes.LIVE:
        return {"mode": mode}
    if mode != session_modes.PREVIEW:
        return {"mode": mode, "study_url": "", "csrf_token": "", "preview_languages": []}
    plan = repository.find(app_context_of(request), slug).plan
    return {
        "mode": mode,
        "study_url": f"/studies/{slug}",
        "csrf_token": form_token(request),
        "preview_languages": [(code, own_name(code)) for code in plan.languages],
    }


def not_open(request: Request, slug: str, app: AppContext) -> Response | None:
    """The page that strangers get instead of a draft's; None where the study may be seen."""
    if not hidden_drafts.is_hidden(request, slug, app):
        return None
    return render(
        request,
        slug,
        "participant/closed.html",
        translatable("Not open"),
        status=409,
        is_draft=True,
        is_paused=False,
    )


def about(request: Request, plan: Plan, language: str | None = None) -> dict[str, Any]:
    """Template values of a study without a session: in this language, or the reader's."""
    chosen = language or languages.of_reader(request, plan.languages)
    return {
        "study_title": plan.text(plan.title, chosen),
        "contact": plan.contact,
        "language": chosen,
        # A session keeps the language in which it began.
        "languages": [] if language else languages.links(request, plan.languages, chosen),
    }


def do(request: Request, slug: str, action: Callable[[], State]) -> Response:
    """Run the action, and redirect to the session's stage, also if the action was out of order."""
    response = to_stage(slug)
    # A second click, another tab, the back button: the page of the stage shows what to do.
    with suppress(ProtocolError, SignInRequiredError, SessionExpiredError):
        state = action()
        token = request.cookies.get(session_cookie(slug))
        is_live = session_paths.mode_of(request) == session_modes.LIVE
        if is_live and state["stage"] in ENDED and token is not None:
            session_cookies.has_ended(response, app_context_of(request), slug, token)
    return response


def _receipt(request: Request, slug: str, state: State | None) -> str | None:
    """The receipt code, on pages that may show it."""
    token = request.cookies.get(session_cookie(slug))
    if state is None or token is None or state["stage"] not in _WITH_RECEIPT:
        return None
    has_ended = state["stage"] in ENDED
    if not session_cookies.shows_receipt(request, slug, has_ended=has_ended):
        return None
    return receipts.receipt(app_context_of(request), token)


def to_stage(slug: str, query: str = "") -> Response:
    """Redirect to the page of the stage, keeping the `query` of a newcomer's link."""
    return RedirectResponse(f"/s/{slug}?{query}" if query else f"/s/{slug}", status_code=303)


def token_of(request: Request, slug: str) -> str:
    """The session token in the browser's cookie for this study. Raises SignInRequiredError."""
    token = request.cookies.get(session_cookie(slug))
    if token is None:
        raise SignInRequiredError("this browser has no session of this study")
    return token


def is_known(app: AppContext, token: str) -> bool:
    """Whether the token belongs to a session."""
    try:
        advance.current(app, token)
    except (SignInRequiredError, SessionExpiredError):
        return False
    return True
