"""Signing in and out."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import accounts
from app.services.errors import SignInRequiredError, TooManyError, TooManyTriesError
from app.services.studio import Studio

from .desk import AnybodysForm
from .problems import seconds_until
from .security import (
    FORM_COOKIE,
    SIGN_IN_COOKIE,
    StudioDep,
    form_token,
    new_form_secret,
    set_cookie,
)
from .templating import page

router = APIRouter(include_in_schema=False)


@router.get("/")
def home() -> Response:
    return RedirectResponse("/studies", status_code=303)


@router.get("/sign-in")
def sign_in_page(
    request: Request,
    studio: StudioDep,
    next: str = "/studies",  # noqa: A002 - a field's name
) -> Response:
    return _sign_in_page(request, studio, next, None)


@router.post("/sign-in", dependencies=[AnybodysForm])
def sign_in(
    request: Request,
    studio: StudioDep,
    email: Annotated[str, Form(max_length=254)],
    password: Annotated[str, Form(max_length=1000)],
    next: Annotated[str, Form()] = "/studies",  # noqa: A002
) -> Response:
    try:
        token = accounts.sign_in(studio, email, password)
    except SignInRequiredError:
        return _sign_in_page(
            request, studio, next, "That address and password do not belong together.", status=401
        )
    except TooManyError as error:
        refusal = _sign_in_page(request, studio, next, _too_many(studio, error), status=429)
        refusal.headers["Retry-After"] = str(seconds_until(studio, error))
        return refusal
    response = RedirectResponse(_own_path(next), status_code=303)
    set_cookie(
        response,
        studio,
        SIGN_IN_COOKIE,
        token,
        max_age=int(accounts.SIGN_IN_LASTS.total_seconds()),
    )
    return response


@router.post("/sign-out", dependencies=[AnybodysForm])
def sign_out(request: Request, studio: StudioDep) -> Response:
    accounts.sign_out(studio, request.cookies.get(SIGN_IN_COOKIE, ""))
    response = RedirectResponse("/sign-in", status_code=303)
    response.delete_cookie(SIGN_IN_COOKIE)
    return response


def _sign_in_page(
    request: Request, studio: Studio, following: str, error: str | None, status: int = 200
) -> Response:
    return page_with_form(
        request,
        studio,
        "experimenter/sign_in.html",
        "Sign in",
        status=status,
        error=error,
        next=_own_path(following),
    )


def page_with_form(
    request: Request, studio: Studio, template: str, title: str, status: int = 200, **context: Any
) -> Response:
    """A page with a form for somebody who need not be signed in."""
    fresh = None
    if FORM_COOKIE not in request.cookies and SIGN_IN_COOKIE not in request.cookies:
        fresh = new_form_secret()
        request.cookies[FORM_COOKIE] = fresh
    values = {
        "page_title": title,
        "csrf_token": form_token(request),
        "experimenter": None,
        **context,
    }
    response = page(request, template, values, status_code=status)
    if fresh is not None:
        set_cookie(response, studio, FORM_COOKIE, fresh)
    return response


def _too_many(studio: Studio, error: TooManyError) -> str:
    if isinstance(error, TooManyTriesError):
        return too_many_tries(studio, error)
    return "Too many are signing in just now. Please try again in a moment."


def too_many_tries(studio: Studio, error: TooManyTriesError) -> str:
    """When the next try counts, for somebody who may well be who they say they are."""
    minutes = -(-seconds_until(studio, error) // 60)
    wait = "in a minute" if minutes <= 1 else f"in {minutes} minutes"
    return f"Too many tries for this address. Please try again {wait}."


def _own_path(path: str) -> str:
    """The path if it is one of ours: nobody is sent to another site after signing in."""
    is_own = path.startswith("/") and not path.startswith(("//", "/\\"))
    return path if is_own else "/studies"
