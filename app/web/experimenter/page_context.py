"""Dependencies of experimenters' pages: sign-in, rights, form tokens, and the layout."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

from fastapi import Depends, Form, Request
from fastapi.responses import Response

from app.services.accounts.accounts import Principal, Role
from app.services.runtime.errors import ForbiddenError
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo
from app.web.http.security import AppDep, MaybeExperimenterDep, check_form_token, form_token
from app.web.http.templating import page


class ToSignIn(Exception):  # noqa: N818 - not a fault: a way to go
    """Raised for a page that requires a sign-in, when the caller is not signed in."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.location = f"/sign-in?next={quote(path)}"


def signed_in(request: Request, caller: MaybeExperimenterDep) -> Principal:
    """The signed-in caller. Raises ToSignIn."""
    if caller is None:
        raise ToSignIn(request.url.path)
    return caller


def from_own_form(request: Request, csrf_token: Annotated[str, Form()]) -> None:
    """Raises ForbiddenError unless the form has this browser's form token."""
    check_form_token(request, csrf_token)


def of_study(right: Right) -> Any:
    """A dependency: the study in the path, if the signed-in caller has this right."""

    def found(slug: str, app: AppDep, caller: SignedIn) -> StudyInfo:
        return access.study_for(app, caller, slug, right)

    return Depends(found)


SignedIn = Annotated[Principal, Depends(signed_in)]


def at_the_browser(caller: SignedIn) -> Principal:
    """The caller signed in in a browser. Raises ForbiddenError for API tokens.

    A token that could create tokens or change roles would remain effective after its revocation.
    """
    if caller.sign_in_id is None:
        raise ForbiddenError("expected somebody who is signed in, and an API token cannot do this")
    return caller


AtBrowser = Annotated[Principal, Depends(at_the_browser)]


def admin(caller: AtBrowser) -> Principal:
    """An admin signed in in a browser. Raises ForbiddenError for all others."""
    if caller.role is not Role.ADMIN:
        raise ForbiddenError(f"expected an admin, and {caller.email} is none")
    return caller


Admin = Annotated[Principal, Depends(admin)]


def from_signed_in_form(
    _caller: SignedIn, request: Request, csrf_token: Annotated[str, Form()]
) -> None:
    """As `from_own_form`, for signed-in callers; others are redirected to sign in first."""
    check_form_token(request, csrf_token)


#: For `dependencies=[...]` of every route that takes a form: OwnForm, for signed-in callers.
OwnForm = Depends(from_signed_in_form)
AnybodysForm = Depends(from_own_form)

DesignOf = Annotated[StudyInfo, of_study(Right.DESIGN)]
DataOf = Annotated[StudyInfo, of_study(Right.DATA)]
ChangeOf = Annotated[StudyInfo, of_study(Right.CHANGE)]
OwnerOf = Annotated[StudyInfo, of_study(Right.OWN)]


def experimenter_page(
    request: Request,
    caller: Principal,
    template: str,
    title: str,
    status_code: int = 200,
    **context: Any,
) -> Response:
    """A page within the layout of experimenters' pages."""
    values = {
        "page_title": title,
        "email": caller.email,
        "experimenter": caller,
        "csrf_token": form_token(request),
        **context,
    }
    return page(request, template, values, status_code=status_code)
