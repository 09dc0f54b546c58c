"""The admins' page of accounts: list, invitations, resets, disabling, roles."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts import administration, invitations
from app.services.accounts.accounts import LONGEST_ADDRESS, Principal, Role
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError
from app.web.http.public_address import base_url
from app.web.http.security import AppDep

from .page_context import Admin, OwnForm, experimenter_page

router = APIRouter(prefix="/accounts", include_in_schema=False)

Email = Annotated[str, Form(max_length=LONGEST_ADDRESS)]


@router.get("")
def accounts_page(request: Request, app: AppDep, caller: Admin) -> Response:
    """The list of accounts and open invitations."""
    return _page(request, app, caller)


@router.post("/invite", dependencies=[OwnForm])
def invite(
    request: Request, app: AppDep, caller: Admin, email: Email, role: Annotated[Role, Form()]
) -> Response:
    """Create an invitation link; this response is the only one that shows it."""
    try:
        path = invitations.invite(app, email, role, caller.email)
    except ConflictError as error:
        return _page(request, app, caller, fault=str(error), email=email)
    return _page(request, app, caller, link=path, for_whom=email)


@router.post("/reset", dependencies=[OwnForm])
def reset(request: Request, app: AppDep, caller: Admin, email: Email) -> Response:
    """Create a link to set a new password; this response is the only one that shows it."""
    try:
        path = invitations.reset(app, email, caller.email)
    except (ConflictError, NotFoundError) as error:
        return _page(request, app, caller, fault=str(error))
    return _page(request, app, caller, link=path, for_whom=email)


@router.post("/role", dependencies=[OwnForm])
def change_role(
    request: Request, app: AppDep, caller: Admin, email: Email, role: Annotated[Role, Form()]
) -> Response:
    """Change the role of an account."""
    try:
        administration.change_role(app, email, role, caller.email)
    except (ConflictError, NotFoundError) as error:
        return _page(request, app, caller, fault=str(error))
    return _back()


@router.post("/disable", dependencies=[OwnForm])
def disable(request: Request, app: AppDep, caller: Admin, email: Email) -> Response:
    """Disable an account."""
    try:
        administration.disable(app, email, caller.email)
    except (ConflictError, NotFoundError) as error:
        return _page(request, app, caller, fault=str(error))
    return _back()


@router.post("/enable", dependencies=[OwnForm])
def enable(request: Request, app: AppDep, caller: Admin, email: Email) -> Response:
    """Enable an account."""
    try:
        administration.enable(app, email, caller.email)
    except NotFoundError as error:
        return _page(request, app, caller, fault=str(error))
    return _back()


@router.post("/invitations/{invitation_id}/take-back", dependencies=[OwnForm])
def take_back(invitation_id: int, app: AppDep, caller: Admin) -> Response:
    """Revoke an invitation."""
    invitations.revoke(app, invitation_id, caller.email)
    return _back()


def _back() -> Response:
    return RedirectResponse("/accounts", status_code=303)


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    *,
    fault: str | None = None,
    email: str = "",
    link: str | None = None,
    for_whom: str = "",
) -> Response:
    base = base_url(request)
    return experimenter_page(
        request,
        caller,
        "experimenter/accounts.html",
        "Accounts",
        status_code=200 if fault is None else 409,
        accounts=administration.all_accounts(app),
        invitations=invitations.outstanding(app),
        roles=list(Role),
        fault=fault,
        typed=email,
        link=link and f"{base}{link}",
        for_whom=for_whom,
        days=invitations.LASTS.days,
    )
