"""Authentication of requests, form tokens, cookies, and the Content-Security-Policy."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated

from fastapi import Depends, Header, Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool

from app.services.accounts import accounts
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, SignInRequiredError

SIGN_IN_COOKIE = "pbpo_sign_in"
FORM_COOKIE = "pbpo_form"

#: A cookie that outlives a study's longest session; the session's own date decides.
SESSION_COOKIE_SECONDS = 400 * 24 * 3600

POLICY = "Content-Security-Policy"


@lru_cache(maxsize=16)
def content_security_policy(
    videos: str | None = None,
    *,
    form_action: tuple[str, ...] = (),
    frame_ancestors: tuple[str, ...] = (),
) -> str:
    """The Content-Security-Policy of a page: own resources only, and the sites named here.

    videos: the origin of recordings, if it is another one.
    """
    also = f" {videos}" if videos else ""
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "img-src 'self' data:",
            f"media-src 'self' blob:{also}",
            f"connect-src 'self'{also}",
            " ".join(("form-action 'self'", *dict.fromkeys(form_action))),
            " ".join(("frame-ancestors", *(frame_ancestors or ("'none'",)))),
            "base-uri 'none'",
        )
    )


def app_context_of(request: Request) -> AppContext:
    """The application context of the server that received the request."""
    app: AppContext = request.app.state.app
    return app


async def _app_context(request: Request) -> AppContext:
    # Asynchronous, because FastAPI runs synchronous dependencies in a thread, at every call.
    return app_context_of(request)


AppDep = Annotated[AppContext, Depends(_app_context)]


def bearer(authorization: str | None) -> str | None:
    """The token of an Authorization header."""
    scheme, _, token = (authorization or "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


def session_cookie(slug: str) -> str:
    """Name of the cookie that holds a session's token: one per study, so that two can go on."""
    return f"pbpo_session_{slug}"


async def optional_experimenter(
    request: Request,
    app: AppDep,
    authorization: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> Principal | None:
    """The caller, by API token or sign-in cookie; None if neither is valid."""
    if token := bearer(authorization):
        return await run_in_threadpool(_found, accounts.by_api_token, app, token)
    if cookie := request.cookies.get(SIGN_IN_COOKIE):
        return await run_in_threadpool(_found, accounts.by_sign_in, app, cookie)
    # No credentials, as with all evaluators: no thread is needed.
    return None


def _found(
    by: Callable[[AppContext, str], Principal], app: AppContext, secret: str
) -> Principal | None:
    try:
        return by(app, secret)
    except SignInRequiredError:
        return None


def signed_in_now(request: Request) -> Principal | None:
    """The caller whose API token or sign-in came with this request, if it is still valid."""
    app = app_context_of(request)
    if token := bearer(request.headers.get("authorization")):
        return _found(accounts.by_api_token, app, token)
    cookie = request.cookies.get(SIGN_IN_COOKIE)
    return _found(accounts.by_sign_in, app, cookie) if cookie else None


def credential_of(request: Request) -> str:
    """The API token or sign-in that came with this request; empty if there is none."""
    token = bearer(request.headers.get("authorization"))
    return token or request.cookies.get(SIGN_IN_COOKIE) or ""


async def experimenter(
    found: Annotated[Principal | None, Depends(optional_experimenter)],
) -> Principal:
    """The caller. Raises SignInRequiredError."""
    if found is None:
        raise SignInRequiredError("expected an experimenter's API token, or to be signed in")
    return found


MaybeExperimenterDep = Annotated[Principal | None, Depends(optional_experimenter)]
ExperimenterDep = Annotated[Principal, Depends(experimenter)]


def set_cookie(
    response: Response, app: AppContext, name: str, value: str, *, max_age: int | None = None
) -> None:
    """Set an HttpOnly cookie with SameSite=Lax; it is Secure where the settings say so."""
    response.set_cookie(
        name,
        value,
        max_age=max_age,
        httponly=True,
        samesite="lax",
        secure=app.settings.secure_cookies,
    )


def form_token(request: Request) -> str:
    """The token of a form: bound to the sign-in, or to a cookie before it.

    Sign-in tokens are random and secret, so only the page itself can contain a hash of one.
    """
    secret = request.cookies.get(SIGN_IN_COOKIE) or request.cookies.get(FORM_COOKIE) or ""
    return hashlib.sha256(f"form:{secret}".encode()).hexdigest()


def check_form_token(request: Request, given: str) -> None:
    """Raises ForbiddenError unless the form has the token of this browser."""
    has_secret = SIGN_IN_COOKIE in request.cookies or FORM_COOKIE in request.cookies
    expected = form_token(request).encode()
    if not has_secret or not hmac.compare_digest(expected, given.encode(errors="replace")):
        raise ForbiddenError("this form is out of date: go back, reload the page and send it again")


def new_form_secret() -> str:
    """A random value for the form cookie of a browser that is not signed in."""
    return secrets.token_urlsafe(16)
