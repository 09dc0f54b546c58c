"""The pages on which an evaluator stops, or has deleted what they gave."""

from __future__ import annotations

import hashlib
import hmac
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import modes, participation, recruitment, studies, withdrawal
from app.services.errors import NotFoundError, SessionExpiredError, SignInRequiredError
from app.services.state import ENDED, State
from app.services.studio import Studio

from . import entrances, languages, words
from .failing_kindly import FailingKindly
from .in_line import in_line
from .security import StudioDep, session_cookie, set_cookie
from .session_pages import about, do, render, to_stage, token_of
from .words import translatable

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=FailingKindly)

#: For how long the page that says that all is deleted shows its code again, after a reload say.
_PROOF_SECONDS = 3600

_DELETE_TITLE = translatable("Delete my answers")
_NO_RECEIPT = translatable(
    "Nothing is kept under this code."
    " Either it is not quite right, or everything was deleted already."
)


@router.get("/withdraw")
def ask_to_withdraw(slug: str, request: Request, studio: StudioDep) -> Response:
    """What stopping means, before one does."""
    try:
        state = participation.current(studio, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return to_stage(slug)
    if state["stage"] in ENDED:
        return to_stage(slug)
    title = translatable("Stop taking part?")
    return render(request, slug, "participant/withdraw.html", title, state)


@router.post("/withdraw")
@in_line
def withdraw(
    slug: str, request: Request, studio: StudioDep, delete: Annotated[str, Form()] = ""
) -> Response:
    """Stop, and keep what was answered, or delete it."""
    if not delete:
        return do(slug, lambda: withdrawal.withdraw(studio, token_of(request, slug)))
    try:
        state = withdrawal.withdraw_and_delete(studio, token_of(request, slug))
    except SignInRequiredError:
        # The second half of a double click: nothing is there any more.
        return to_stage(slug)
    return _to_deleted(request, studio, slug, state["language"])


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
        **_about(request, studio, slug, state),
        fault=None,
        typed="",
    )


@router.post("/delete")
@in_line
def delete(
    slug: str, request: Request, studio: StudioDep, receipt: Annotated[str, Form()] = ""
) -> Response:
    """Delete what the holder of this receipt gave."""
    said = _about(request, studio, slug)
    try:
        withdrawal.delete_by_receipt(studio, slug, receipt)
    except NotFoundError:
        return render(
            request,
            slug,
            "participant/delete.html",
            _DELETE_TITLE,
            status=404,
            **said,
            fault=words.translated(_NO_RECEIPT, said["language"]),
            typed=receipt[:64],
        )
    return _to_deleted(request, studio, slug, said["language"])


@router.get("/deleted")
def deleted(slug: str, request: Request, studio: StudioDep) -> Response:
    """What a browser without a session is told; the way back needs no id that was deleted.

    A code is shown to the browser that has just deleted a session, and to nobody who opens this.
    """
    plan = studies.find(studio, slug).plan
    proof = request.cookies.get(_proof_cookie(slug), "")
    is_due = hmac.compare_digest(_proof(studio, slug).encode(), proof.encode(errors="replace"))
    is_due = is_due and entrances.mode_of(request) == modes.LIVE
    return render(
        request,
        slug,
        "participant/deleted.html",
        translatable("Everything is deleted"),
        **about(request, plan),
        way_back=recruitment.described(plan, "withdrawn") if is_due else None,
    )


def _about(
    request: Request, studio: Studio, slug: str, state: State | None = None
) -> dict[str, Any]:
    """What these pages say of the study, in the language of the session if there is one."""
    language = state["language"] if state else None
    return about(request, studies.find(studio, slug).plan, language)


def _proof_cookie(slug: str) -> str:
    return f"pbpo_deleted_{slug}"


def _proof(studio: Studio, slug: str) -> str:
    """What shows that a browser has deleted a session of this study."""
    return hmac.new(studio.secret.key("deleted pages"), slug.encode(), hashlib.sha256).hexdigest()


def _to_deleted(request: Request, studio: Studio, slug: str, language: str) -> Response:
    # The session that knew the language is gone.
    response = RedirectResponse(
        f"/s/{slug}/deleted?{languages.PARAMETER}={language}", status_code=303
    )
    response.delete_cookie(session_cookie(slug))
    if entrances.mode_of(request) == modes.LIVE:
        set_cookie(
            response, studio, _proof_cookie(slug), _proof(studio, slug), max_age=_PROOF_SECONDS
        )
    return response
