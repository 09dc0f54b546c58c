"""Pages of invitation and reset links, on which a person sets a password."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.services.accounts import invitations
from app.services.accounts.accounts import MIN_PASSWORD_LENGTH
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, InvitationError
from app.web.http.security import AppDep

from .page_context import AnybodysForm
from .sign_in_pages import page_with_form

router = APIRouter(prefix="/invitations/{token}", include_in_schema=False)


@router.get("")
def choose_password_page(token: str, request: Request, app: AppDep) -> Response:
    """The form to set a password."""
    return _page(request, app, token)


@router.post("", dependencies=[AnybodysForm])
def choose_password(
    token: str,
    request: Request,
    app: AppDep,
    password: Annotated[str, Form(max_length=1000)],
    again: Annotated[str, Form(max_length=1000)],
) -> Response:
    """Set the password; the link is used up."""
    if password != again:
        return _page(request, app, token, fault="The two passwords are not the same.")
    try:
        email = invitations.accept(app, token, password)
    except InvitationError as error:
        return _gone(request, app, error)
    except ConflictError as error:
        return _page(request, app, token, fault=str(error))
    return page_with_form(
        request, app, "experimenter/invitation_accepted.html", "Password chosen", address=email
    )


def _page(request: Request, app: AppContext, token: str, fault: str | None = None) -> Response:
    try:
        invited = invitations.find(app, token)
    except InvitationError as error:
        return _gone(request, app, error)
    return page_with_form(
        request,
        app,
        "experimenter/invitation.html",
        "Choose a password",
        status=200 if fault is None else 409,
        invited=invited,
        fault=fault,
        shortest=MIN_PASSWORD_LENGTH,
    )


def _gone(request: Request, app: AppContext, error: InvitationError) -> Response:
    return page_with_form(
        request,
        app,
        "experimenter/invitation_gone.html",
        "This link cannot be used",
        status=410,
        why=str(error),
    )
