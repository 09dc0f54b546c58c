"""Re-entry: return to one's session from another browser, or start anew on a shared one."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.services.arrival import re_entry, session_holder
from app.services.context import AppContext
from app.services.runtime.errors import (
    AlreadyTakenPartError,
    KnownPersonError,
    NotFoundError,
    SessionExpiredError,
    SignInRequiredError,
)
from app.services.sessions import advance
from app.services.sessions.state_view import ENDED
from app.services.studies import repository
from app.web.http.concurrency import limited_write
from app.web.http.security import AppDep
from app.web.http.translations import translatable

from . import arrival_parameters, refusal_pages, session_cookies
from .error_pages import EvaluatorRoute
from .session_pages import about, render, to_stage, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)


@router.post("/return")
@limited_write
def come_back(
    slug: str, request: Request, app: AppDep, receipt: Annotated[str, Form()] = ""
) -> Response:
    """Return to a session by its receipt code or by the platform's submission id."""
    repository.find(app, slug)
    refused = refusal_pages.without_cookies(request, slug, app)
    if refused is not None:
        return refused
    try:
        if receipt:
            token = _by_receipt(app, slug, receipt)
        else:
            token = re_entry.resume_by_ids(
                app, slug, arrival_parameters.given(request, slug, app).ids
            )
    except _NotAReceiptError as error:
        return refusal_pages.unknown_browser(request, slug, app, error, is_wrong=True)
    except (AlreadyTakenPartError, KnownPersonError) as error:
        return refusal_pages.refused(request, slug, app, error)
    except (NotFoundError, SessionExpiredError):
        # No session has these ids any more, or its resume limit has passed.
        return to_stage(slug, request.url.query)
    response = session_cookies.forget(to_stage(slug), slug)
    session_cookies.keep_session(response, app, slug, token)
    return response


class _NotAReceiptError(KnownPersonError):
    """The receipt code belongs to no session."""


def _by_receipt(app: AppContext, slug: str, receipt: str) -> str:
    try:
        return re_entry.resume_by_receipt(app, slug, receipt)
    except NotFoundError as error:
        raise _NotAReceiptError(str(error), may_resume=False) from error


@router.post("/claim")
@limited_write
def claim(slug: str, request: Request, app: AppDep) -> Response:
    """Confirm having begun in this browser: the link's ids are added to its session."""
    ids = arrival_parameters.given(request, slug, app).ids
    try:
        session_holder.add_ids(app, slug, token_of(request, slug), ids)
    except KnownPersonError as error:
        return refusal_pages.unknown_browser(request, slug, app, error)
    except SignInRequiredError:
        return to_stage(slug, request.url.query)
    return to_stage(slug)


@router.get("/not-you")
def ask_who(slug: str, request: Request, app: AppDep) -> Response:
    """The confirmation page before the browser's session is detached."""
    plan = repository.find(app, slug).plan
    try:
        token = token_of(request, slug)
        state = advance.current(app, token)
    except (SignInRequiredError, SessionExpiredError):
        return to_stage(slug, request.url.query)
    return render(
        request,
        slug,
        "participant/not_you.html",
        translatable("Is it you?"),
        **about(request, plan, state["language"]),
        has_ended=state["stage"] in ENDED,
    )


@router.post("/begin-anew")
@limited_write
def begin_anew(slug: str, request: Request, app: AppDep) -> Response:
    """Detach the browser from the previous person's session. Its data is kept."""
    repository.find(app, slug)
    return session_cookies.forget(to_stage(slug, request.url.query), slug)
