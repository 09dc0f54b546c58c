"""Signing in and out."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar
from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts import accounts, password_hash_limit
from app.services.context import AppContext
from app.services.runtime.errors import SignInRequiredError, TooManyError, TooManyTriesError
from app.web.http.problems import seconds_until
from app.web.http.security import (
    FORM_COOKIE,
    SIGN_IN_COOKIE,
    AppDep,
    form_token,
    new_form_secret,
    set_cookie,
)
from app.web.http.templating import page

from . import known_devices
from .page_context import AnybodysForm

router = APIRouter(include_in_schema=False)

#: Threads for password checks: of unknown browsers, and of known ones.
_THREADS: RunVar[tuple[CapacityLimiter, CapacityLimiter]] = RunVar("threads for sign-ins")


@router.get("/")
def home() -> Response:
    """Redirect to the list of studies."""
    return RedirectResponse("/studies", status_code=303)


@router.get("/sign-in")
def sign_in_page(
    request: Request,
    app: AppDep,
    next: str = "/studies",  # noqa: A002 - a field's name
) -> Response:
    """The sign-in form."""
    return _sign_in_page(request, app, next, None)


@router.post("/sign-in", dependencies=[AnybodysForm])
async def sign_in(
    request: Request,
    app: AppDep,
    email: Annotated[str, Form(max_length=254)],
    password: Annotated[str, Form(max_length=1000)],
    next: Annotated[str, Form()] = "/studies",  # noqa: A002
) -> Response:
    """Sign in, or show the form again with the reason."""
    came_from = known_devices.came_from(request, app, email)
    is_known = came_from.device is not None
    check = partial(accounts.sign_in, app, email, password, came_from)
    try:
        # In threads of their own, so that waiting checks take none from other pages.
        token = await to_thread.run_sync(check, limiter=_threads(is_known=is_known))
    except SignInRequiredError:
        return _sign_in_page(
            request, app, next, "That address and password do not belong together.", status=401
        )
    except TooManyError as error:
        refusal = _sign_in_page(request, app, next, _too_many(app, error), status=429)
        refusal.headers["Retry-After"] = str(seconds_until(app, error))
        return refusal
    response = RedirectResponse(_own_path(next), status_code=303)
    set_cookie(
        response,
        app,
        SIGN_IN_COOKIE,
        token,
        max_age=int(accounts.SIGN_IN_LASTS.total_seconds()),
    )
    known_devices.remember(request, response, app, email)
    return response


def _threads(*, is_known: bool) -> CapacityLimiter:
    """Room for all that may wait for their turn, and some that are told to come back."""
    try:
        return _THREADS.get()[is_known]
    except LookupError:
        others = CapacityLimiter(password_hash_limit.MAX_WAITING + 16)
        known = CapacityLimiter(password_hash_limit.MAX_WAITING_KNOWN + 16)
        _THREADS.set((others, known))
        return _THREADS.get()[is_known]


@router.post("/sign-out", dependencies=[AnybodysForm])
def sign_out(request: Request, app: AppDep) -> Response:
    """Sign out of this browser."""
    accounts.sign_out(app, request.cookies.get(SIGN_IN_COOKIE, ""))
    response = RedirectResponse("/sign-in", status_code=303)
    response.delete_cookie(SIGN_IN_COOKIE)
    return response


def _sign_in_page(
    request: Request, app: AppContext, following: str, error: str | None, status: int = 200
) -> Response:
    return page_with_form(
        request,
        app,
        "experimenter/sign_in.html",
        "Sign in",
        status=status,
        error=error,
        next=_own_path(following),
    )


def page_with_form(
    request: Request, app: AppContext, template: str, title: str, status: int = 200, **context: Any
) -> Response:
    """A page with a form for a visitor who need not be signed in."""
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
        set_cookie(response, app, FORM_COOKIE, fresh)
    return response


def _too_many(app: AppContext, error: TooManyError) -> str:
    if isinstance(error, TooManyTriesError):
        return too_many_tries(app, error)
    return "Too many are signing in just now. Please try again in a moment."


def too_many_tries(app: AppContext, error: TooManyTriesError) -> str:
    """The page after too many failed sign-ins, with the time of the next attempt."""
    seconds = seconds_until(app, error)
    minutes = -(-seconds // 60)
    wait = f"in {seconds} s" if minutes <= 1 else f"in {minutes} minutes"
    return f"Too many tries for this address. Please try again {wait}."


def _own_path(path: str) -> str:
    """The path if it is on this host, so that a sign-in redirects to no other site."""
    is_own = path.startswith("/") and not path.startswith(("//", "/\\"))
    return path if is_own else "/studies"
