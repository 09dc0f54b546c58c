"""Whose session is it: back into one's own from another browser, or begun anew by somebody else."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.services import holding, participation, returning, studies
from app.services.errors import (
    AlreadyTakenPartError,
    KnownPersonError,
    NotFoundError,
    SessionExpiredError,
    SignInRequiredError,
)
from app.services.state import ENDED
from app.services.studio import Studio

from . import arrivals, browser_cookies, turned_away
from .failing_kindly import FailingKindly
from .in_line import in_line
from .security import StudioDep
from .session_pages import about, render, to_stage, token_of
from .words import translatable

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=FailingKindly)


@router.post("/return")
@in_line
def come_back(
    slug: str, request: Request, studio: StudioDep, receipt: Annotated[str, Form()] = ""
) -> Response:
    """Back into one's session: by its receipt code, or by the platform's id of the submission."""
    studies.find(studio, slug)
    refused = turned_away.without_cookies(request, slug, studio)
    if refused is not None:
        return refused
    try:
        if receipt:
            token = _by_receipt(studio, slug, receipt)
        else:
            token = returning.come_back(studio, slug, arrivals.given(request, slug, studio).ids)
    except _NotAReceiptError as error:
        return turned_away.unknown_browser(request, slug, studio, error, is_wrong=True)
    except (AlreadyTakenPartError, KnownPersonError) as error:
        return turned_away.refused(request, slug, studio, error)
    except (NotFoundError, SessionExpiredError):
        # Nobody is known by these ids any more, or they were away for too long.
        return to_stage(slug, request.url.query)
    response = browser_cookies.forget(to_stage(slug), slug)
    browser_cookies.keep_session(response, studio, slug, token)
    return response


class _NotAReceiptError(KnownPersonError):
    """A receipt code was typed that belongs to no session."""


def _by_receipt(studio: Studio, slug: str, receipt: str) -> str:
    try:
        return returning.come_back_by_receipt(studio, slug, receipt)
    except NotFoundError as error:
        raise _NotAReceiptError(str(error), may_resume=False) from error


@router.post("/claim")
@in_line
def claim(slug: str, request: Request, studio: StudioDep) -> Response:
    """Say that one is the person who began in this browser: the link's ids are added."""
    ids = arrivals.given(request, slug, studio).ids
    try:
        holding.add_ids(studio, slug, token_of(request, slug), ids)
    except KnownPersonError as error:
        return turned_away.unknown_browser(request, slug, studio, error)
    except SignInRequiredError:
        return to_stage(slug, request.url.query)
    return to_stage(slug)


@router.get("/not-you")
def ask_who(slug: str, request: Request, studio: StudioDep) -> Response:
    """Before the browser lets go of the session that it holds."""
    plan = studies.find(studio, slug).plan
    try:
        token = token_of(request, slug)
        state = participation.current(studio, token)
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
@in_line
def begin_anew(slug: str, request: Request, studio: StudioDep) -> Response:
    """Have the browser forget the session of the last person at it. What they gave is kept."""
    studies.find(studio, slug)
    return browser_cookies.forget(to_stage(slug, request.url.query), slug)
