"""My account: password, browsers that are signed in, and tokens for programs."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import accounts, credentials
from app.services.accounts import Experimenter, Scope
from app.services.errors import ConflictError, ForbiddenError, TooManyTriesError
from app.services.studio import Studio

from .desk import AtBrowser, OwnForm, desk_page
from .security import StudioDep
from .sign_in_pages import too_many_tries

router = APIRouter(prefix="/account", include_in_schema=False)

Password = Annotated[str, Form(max_length=1000)]


@router.get("")
def account_page(
    request: Request, studio: StudioDep, caller: AtBrowser, changed: str = ""
) -> Response:
    return _page(request, studio, caller, password_changed=changed == "password")


@router.post("/password", dependencies=[OwnForm])
def change_password(
    request: Request,
    studio: StudioDep,
    caller: AtBrowser,
    old: Password,
    new: Password,
    again: Password,
) -> Response:
    if new != again:
        fault = "The two new passwords are not the same."
        return _page(request, studio, caller, 409, password_fault=fault)
    try:
        credentials.change_password(studio, caller, old, new)
    except TooManyTriesError as error:
        fault = too_many_tries(studio, error)
        return _page(request, studio, caller, 429, password_fault=fault)
    except (ForbiddenError, ConflictError) as error:
        return _page(request, studio, caller, 409, password_fault=str(error))
    return RedirectResponse("/account?changed=password", status_code=303)


@router.post("/sign-ins/end-others", dependencies=[OwnForm])
def end_other_sign_ins(studio: StudioDep, caller: AtBrowser) -> Response:
    credentials.end_sign_ins(studio, caller)
    return _back("sign-ins")


@router.post("/sign-ins/{sign_in_id}/end", dependencies=[OwnForm])
def end_sign_in(sign_in_id: int, studio: StudioDep, caller: AtBrowser) -> Response:
    credentials.end_sign_ins(studio, caller, sign_in_id)
    return _back("sign-ins")


@router.post("/tokens", dependencies=[OwnForm])
def make_token(
    request: Request,
    studio: StudioDep,
    caller: AtBrowser,
    label: Annotated[str, Form()],
    scope: Annotated[Scope, Form()],
    days: Annotated[int, Form()],
) -> Response:
    """Make a token, and show it this once."""
    try:
        token = credentials.make_api_token(studio, caller, label, scope, days)
    except ConflictError as error:
        return _page(request, studio, caller, 409, token_fault=str(error))
    return _page(request, studio, caller, token=token)


@router.post("/tokens/{token_id}/revoke", dependencies=[OwnForm])
def revoke_token(token_id: int, studio: StudioDep, caller: AtBrowser) -> Response:
    credentials.revoke_api_token(studio, caller, token_id)
    return _back("tokens")


def _back(place: str) -> Response:
    return RedirectResponse(f"/account#{place}", status_code=303)


def _page(
    request: Request,
    studio: Studio,
    caller: Experimenter,
    status: int = 200,
    *,
    password_changed: bool = False,
    password_fault: str | None = None,
    token: str | None = None,
    token_fault: str | None = None,
) -> Response:
    return desk_page(
        request,
        caller,
        "experimenter/account.html",
        "My account",
        status_code=status,
        password_changed=password_changed,
        password_fault=password_fault,
        shortest=accounts.MIN_PASSWORD_LENGTH,
        sign_ins=credentials.sign_ins(studio, caller),
        tokens=credentials.api_tokens(studio, caller),
        token=token,
        token_fault=token_fault,
        most_days=credentials.MOST_DAYS,
        longest_label=credentials.LONGEST_LABEL,
    )
