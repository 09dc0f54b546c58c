"""Pages on which an evaluator withdraws or has their data deleted."""

from __future__ import annotations

import hashlib
import hmac
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.context import AppContext
from app.services.runtime.errors import (
    ForbiddenError,
    NotFoundError,
    SessionExpiredError,
    SignInRequiredError,
)
from app.services.sessions import advance, receipts, withdrawal
from app.services.sessions.state_view import ENDED
from app.services.studies import repository, session_modes
from app.study import recruitment
from app.web.http import languages, session_paths, translations
from app.web.http.concurrency import limited_write
from app.web.http.security import AppDep, set_cookie
from app.web.http.translations import translatable
from app.web.http.wordings import wording_of

from . import session_cookies
from .error_pages import EvaluatorRoute
from .session_pages import about, do, not_open, render, to_stage, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)

#: For how long the page after a deletion shows its code again, after a reload for example.
_PROOF_SECONDS = 3600

_DELETE_TITLE = translatable("Delete my answers")
_NO_RECEIPT = translatable(
    "Nothing is kept under this code."
    " Either it is not quite right, or everything was deleted already."
)


@router.get("/withdraw")
def ask_to_withdraw(slug: str, request: Request, app: AppDep) -> Response:
    """The confirmation page before withdrawing."""
    try:
        state = advance.current(app, token_of(request, slug))
    except (SignInRequiredError, SessionExpiredError):
        return to_stage(slug)
    if state["stage"] in ENDED:
        return to_stage(slug)
    title = translatable("Stop taking part?")
    receipt = receipts.receipt(app, token_of(request, slug))
    return render(
        request,
        slug,
        "participant/withdraw.html",
        title,
        state,
        # A platform's ids give access to a session, but not to its deletion.
        may_delete=receipt is not None,
    )


@router.post("/withdraw")
@limited_write
def withdraw(
    slug: str, request: Request, app: AppDep, delete: Annotated[str, Form()] = ""
) -> Response:
    """Withdraw, and keep or delete the responses."""
    if not delete:
        return do(request, slug, lambda: withdrawal.withdraw(app, token_of(request, slug)))
    try:
        state = withdrawal.withdraw_and_delete(app, token_of(request, slug))
    except SignInRequiredError:
        # The second half of a double click: nothing is there any more.
        return to_stage(slug)
    except ForbiddenError:
        return RedirectResponse(f"/s/{slug}/withdraw", status_code=303)
    return _to_deleted(request, app, slug, state["language"])


@router.get("/delete")
def ask_for_receipt(slug: str, request: Request, app: AppDep) -> Response:
    """The form for a receipt code. It is never prefilled: the browser may be shared."""
    hidden = not_open(request, slug, app)
    if hidden is not None:
        return hidden
    return _delete_page(request, app, slug)


@router.post("/delete")
@limited_write
def delete(
    slug: str,
    request: Request,
    app: AppDep,
    receipt: Annotated[str, Form()] = "",
    confirmed: Annotated[str, Form()] = "",
) -> Response:
    """Ask for confirmation, then delete the data of the holder of this receipt."""
    language = languages.of_reader(request, repository.find(app, slug).plan.languages)
    try:
        if not withdrawal.is_receipt(app, slug, receipt):
            raise NotFoundError("nothing is kept for this receipt code")
        if not confirmed:
            return _delete_page(request, app, slug, typed=receipt, is_found=True)
        withdrawal.delete_by_receipt(app, slug, receipt)
    except NotFoundError:
        fault = translations.translated(_NO_RECEIPT, wording_of(app, slug, language))
        return _delete_page(request, app, slug, status=404, fault=fault, typed=receipt)
    return _to_deleted(request, app, slug, language)


def _delete_page(
    request: Request,
    app: AppContext,
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
        **about(request, repository.find(app, slug).plan),
        fault=fault,
        typed=typed[:64],
        is_found=is_found,
    )


@router.get("/deleted")
def deleted(slug: str, request: Request, app: AppDep) -> Response:
    """The page after a deletion; its return link needs no id that was deleted.

    The completion code is shown only to the browser that has just deleted a session.
    """
    hidden = not_open(request, slug, app)
    if hidden is not None:
        return hidden
    plan = repository.find(app, slug).plan
    proof = request.cookies.get(_proof_cookie(slug), "")
    is_due = hmac.compare_digest(_proof(app, slug).encode(), proof.encode(errors="replace"))
    is_due = is_due and session_paths.mode_of(request) == session_modes.LIVE
    return render(
        request,
        slug,
        "participant/deleted.html",
        translatable("Everything is deleted"),
        **about(request, plan),
        way_back=recruitment.described(plan.recruitment, "withdrawn") if is_due else None,
    )


def _proof_cookie(slug: str) -> str:
    return f"pbpo_deleted_{slug}"


def _proof(app: AppContext, slug: str) -> str:
    """The cookie value that proves that a browser has deleted a session of this study."""
    return hmac.new(app.secret.key("deleted pages"), slug.encode(), hashlib.sha256).hexdigest()


def _to_deleted(request: Request, app: AppContext, slug: str, language: str) -> Response:
    # The session that knew the language is gone.
    response = RedirectResponse(
        f"/s/{slug}/deleted?{languages.PARAMETER}={language}", status_code=303
    )
    session_cookies.forget(response, slug)
    if session_paths.mode_of(request) == session_modes.LIVE:
        set_cookie(response, app, _proof_cookie(slug), _proof(app, slug), max_age=_PROOF_SECONDS)
    return response
