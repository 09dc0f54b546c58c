"""The pages on which an evaluator stops, or has deleted what they gave."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import participation, recruitment, studies, withdrawal
from app.services.errors import NotFoundError, SessionExpiredError, SignInRequiredError
from app.services.state import ENDED
from app.services.studio import Studio

from .failing_kindly import FailingKindly
from .security import StudioDep, session_cookie
from .session_pages import do, render, to_stage, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=FailingKindly)

_DELETE_TITLE = "Delete my answers"


@router.get("/withdraw")
def ask_to_withdraw(slug: str, request: Request, studio: StudioDep) -> Response:
    """What stopping means, before one does."""
    try:
        state = participation.current(studio, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return to_stage(slug)
    if state["stage"] in ENDED:
        return to_stage(slug)
    return render(request, slug, "participant/withdraw.html", "Stop taking part?", state)


@router.post("/withdraw")
def withdraw(
    slug: str, request: Request, studio: StudioDep, delete: Annotated[str, Form()] = ""
) -> Response:
    """Stop, and keep what was answered, or delete it."""
    if not delete:
        return do(slug, lambda: withdrawal.withdraw(studio, token_of(request, slug)))
    try:
        withdrawal.withdraw_and_delete(studio, token_of(request, slug))
    except SignInRequiredError:
        # The second half of a double click: nothing is there any more.
        return to_stage(slug)
    return _to_deleted(slug)


@router.get("/delete")
def ask_for_receipt(slug: str, request: Request, studio: StudioDep) -> Response:
    """Where a receipt's code is typed; a browser that still has its session need not type."""
    token = request.cookies.get(session_cookie(slug))
    state = None
    if token is not None:
        try:
            state = participation.current(studio, token)
        except (SignInRequiredError, SessionExpiredError):
            state = None
    return render(
        request,
        slug,
        "participant/delete.html",
        _DELETE_TITLE,
        state,
        **_about(studio, slug),
        fault=None,
        typed="",
    )


@router.post("/delete")
def delete(
    slug: str, request: Request, studio: StudioDep, receipt: Annotated[str, Form()] = ""
) -> Response:
    """Delete what the holder of this receipt gave."""
    about = _about(studio, slug)
    try:
        withdrawal.delete_by_receipt(studio, slug, receipt)
    except NotFoundError:
        return render(
            request,
            slug,
            "participant/delete.html",
            _DELETE_TITLE,
            status=404,
            **about,
            fault="Nothing is kept under this code. Either it is not quite right, or everything "
            "was deleted already.",
            typed=receipt[:64],
        )
    return _to_deleted(slug)


@router.get("/deleted")
def deleted(slug: str, request: Request, studio: StudioDep) -> Response:
    """What a browser without a session is told; the way back needs no id that was deleted."""
    plan = studies.find(studio, slug).plan
    return render(
        request,
        slug,
        "participant/deleted.html",
        "Everything is deleted",
        **_about(studio, slug),
        way_back=recruitment.described(plan, "withdrawn"),
    )


def _about(studio: Studio, slug: str) -> dict[str, Any]:
    """What a page says of the study to somebody who has no session of it."""
    plan = studies.find(studio, slug).plan
    return {
        "study_title": plan.text(plan.title, plan.default_language),
        "contact": plan.contact,
        "language": plan.default_language,
    }


def _to_deleted(slug: str) -> Response:
    response = RedirectResponse(f"/s/{slug}/deleted", status_code=303)
    response.delete_cookie(session_cookie(slug))
    return response
