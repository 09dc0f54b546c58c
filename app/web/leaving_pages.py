"""The pages on which an evaluator stops, or has deleted what they gave."""

from __future__ import annotations

import hashlib
import hmac
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import holding, modes, participation, recruitment, studies, withdrawal
from app.services.errors import (
    ForbiddenError,
    NotFoundError,
    SessionExpiredError,
    SignInRequiredError,
)
from app.services.state import ENDED
from app.services.studio import Studio

from . import browser_cookies, entrances, languages, words
from .failing_kindly import FailingKindly
from .in_line import in_line
from .security import StudioDep, set_cookie
from .session_pages import about, do, not_open, render, to_stage, token_of
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
    receipt = holding.receipt(studio, token_of(request, slug))
    return render(
        request,
        slug,
        "participant/withdraw.html",
        title,
        state,
        # A platform's ids lead back into a session, and no further.
        may_delete=receipt is not None,
    )


@router.post("/withdraw")
@in_line
def withdraw(
    slug: str, request: Request, studio: StudioDep, delete: Annotated[str, Form()] = ""
) -> Response:
    """Stop, and keep what was answered, or delete it."""
    if not delete:
        return do(request, slug, lambda: withdrawal.withdraw(studio, token_of(request, slug)))
    try:
        state = withdrawal.withdraw_and_delete(studio, token_of(request, slug))
    except SignInRequiredError:
        # The second half of a double click: nothing is there any more.
        return to_stage(slug)
    except ForbiddenError:
        return RedirectResponse(f"/s/{slug}/withdraw", status_code=303)
    return _to_deleted(request, studio, slug, state["language"])


@router.get("/delete")
def ask_for_receipt(slug: str, request: Request, studio: StudioDep) -> Response:
    """Where a receipt's code is typed: none is filled in, for the browser may be shared."""
    hidden = not_open(request, slug, studio)
    if hidden is not None:
        return hidden
    return _delete_page(request, studio, slug)


@router.post("/delete")
@in_line
def delete(
    slug: str,
    request: Request,
    studio: StudioDep,
    receipt: Annotated[str, Form()] = "",
    confirmed: Annotated[str, Form()] = "",
) -> Response:
    """Ask once more, and then delete what the holder of this receipt gave."""
    language = languages.of_reader(request, studies.find(studio, slug).plan.languages)
    try:
        if not withdrawal.is_receipt(studio, slug, receipt):
            raise NotFoundError("nothing is kept for this receipt code")
        if not confirmed:
            return _delete_page(request, studio, slug, typed=receipt, is_found=True)
        withdrawal.delete_by_receipt(studio, slug, receipt)
    except NotFoundError:
        fault = words.translated(_NO_RECEIPT, language)
        return _delete_page(request, studio, slug, status=404, fault=fault, typed=receipt)
    return _to_deleted(request, studio, slug, language)


def _delete_page(
    request: Request,
    studio: Studio,
    slug: str,
    *,
    status: int = 200,
    typed: str = "",
    fault: str | None = None,
    is_found: bool = False,
) -> Response:
    return render(
        request,
        slug,
        "participant/delete.html",
        _DELETE_TITLE,
        status=status,
        **about(request, studies.find(studio, slug).plan),
        fault=fault,
        typed=typed[:64],
        is_found=is_found,
    )


@router.get("/deleted")
def deleted(slug: str, request: Request, studio: StudioDep) -> Response:
    """What a browser without a session is told; the way back needs no id that was deleted.

    A code is shown to the browser that has just deleted a session, and to nobody who opens this.
    """
    hidden = not_open(request, slug, studio)
    if hidden is not None:
        return hidden
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
    browser_cookies.forget(response, slug)
    if entrances.mode_of(request) == modes.LIVE:
        set_cookie(
            response, studio, _proof_cookie(slug), _proof(studio, slug), max_age=_PROOF_SECONDS
        )
    return response
