"""The account page: password, signed-in browsers, and API tokens."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts import accounts, own_account
from app.services.accounts.accounts import Principal, Scope
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, ForbiddenError, TooManyTriesError
from app.web.http.security import AppDep

from .page_context import AtBrowser, OwnForm, experimenter_page
from .sign_in_pages import too_many_tries

router = APIRouter(prefix="/account", include_in_schema=False)

Password = Annotated[str, Form(max_length=1000)]


@router.get("")
def account_page(request: Request, app: AppDep, caller: AtBrowser, changed: str = "") -> Response:
    """The account page."""
    return _page(request, app, caller, password_changed=changed == "password")


@router.post("/password", dependencies=[OwnForm])
def change_password(
    request: Request,
    app: AppDep,
    caller: AtBrowser,
    old: Password,
    new: Password,
    again: Password,
) -> Response:
    """Change the caller's password."""
    if new != again:
        fault = "The two new passwords are not the same."
        return _page(request, app, caller, 409, password_fault=fault)
    try:
        own_account.change_password(app, caller, old, new)
    except TooManyTriesError as error:
        fault = too_many_tries(app, error)
        return _page(request, app, caller, 429, password_fault=fault)
    except (ForbiddenError, ConflictError) as error:
        return _page(request, app, caller, 409, password_fault=str(error))
    return RedirectResponse("/account?changed=password", status_code=303)


@router.post("/sign-ins/end-others", dependencies=[OwnForm])
def end_other_sign_ins(app: AppDep, caller: AtBrowser) -> Response:
    """End the caller's sign-ins in other browsers."""
    own_account.end_sign_ins(app, caller)
    return _back("sign-ins")


@router.post("/sign-ins/{sign_in_id}/end", dependencies=[OwnForm])
def end_sign_in(sign_in_id: int, app: AppDep, caller: AtBrowser) -> Response:
    """End one of the caller's sign-ins."""
    own_account.end_sign_ins(app, caller, sign_in_id)
    return _back("sign-ins")


@router.post("/tokens", dependencies=[OwnForm])
def make_token(
    request: Request,
    app: AppDep,
    caller: AtBrowser,
    label: Annotated[str, Form()],
    scope: Annotated[Scope, Form()],
    days: Annotated[int, Form()],
) -> Response:
    """Create an API token; this response is the only one that shows it."""
    try:
        token = own_account.make_api_token(app, caller, label, scope, days)
    except ConflictError as error:
        return _page(request, app, caller, 409, token_fault=str(error))
    return _page(request, app, caller, token=token)


@router.post("/tokens/{token_id}/revoke", dependencies=[OwnForm])
def revoke_token(token_id: int, app: AppDep, caller: AtBrowser) -> Response:
    """Revoke one of the caller's API tokens."""
    own_account.revoke_api_token(app, caller, token_id)
    return _back("tokens")


def _back(place: str) -> Response:
    return RedirectResponse(f"/account#{place}", status_code=303)


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    status: int = 200,
    *,
    password_changed: bool = False,
    password_fault: str | None = None,
    token: str | None = None,
    token_fault: str | None = None,
) -> Response:
    return experimenter_page(
        request,
        caller,
        "experimenter/account.html",
        "My account",
        status_code=status,
        password_changed=password_changed,
        password_fault=password_fault,
        shortest=accounts.MIN_PASSWORD_LENGTH,
        sign_ins=own_account.sign_ins(app, caller),
        tokens=own_account.api_tokens(app, caller),
        token=token,
        token_fault=token_fault,
        most_days=own_account.MOST_DAYS,
        longest_label=own_account.LONGEST_LABEL,
    )
