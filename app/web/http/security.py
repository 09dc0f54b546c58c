"""Who is asking, and what a browser may do with our pages."""

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
    """What a page of ours may do: nothing but with ourselves, and with the sites named here.

    videos: the site that recordings come from, where that is not ours.
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


def studio_of(request: Request) -> AppContext:
    app: AppContext = request.app.state.app
    return app


async def _studio(request: Request) -> AppContext:
    # What only looks something up is asynchronous: anything else is given to a thread and waited
    # for, at every call, and on a busy server each of these waits counts.
    return studio_of(request)


AppDep = Annotated[AppContext, Depends(_studio)]


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
    """The experimenter who asks, by API token or by being signed in; None if nobody is."""
    if token := bearer(authorization):
        return await run_in_threadpool(_found, accounts.by_api_token, app, token)
    if cookie := request.cookies.get(SIGN_IN_COOKIE):
        return await run_in_threadpool(_found, accounts.by_sign_in, app, cookie)
    # Nobody, as all evaluators: a crowd that comes waits for no thread.
    return None


def _found(
    by: Callable[[AppContext, str], Principal], app: AppContext, secret: str
) -> Principal | None:
    try:
        return by(app, secret)
    except SignInRequiredError:
        return None


def signed_in_now(request: Request) -> Principal | None:
    """The experimenter whose API token or sign-in came with this, if it is still in force."""
    app = studio_of(request)
    if token := bearer(request.headers.get("authorization")):
        return _found(accounts.by_api_token, app, token)
    cookie = request.cookies.get(SIGN_IN_COOKIE)
    return _found(accounts.by_sign_in, app, cookie) if cookie else None


async def experimenter(
    found: Annotated[Principal | None, Depends(optional_experimenter)],
) -> Principal:
    """The experimenter who asks. Raises SignInRequiredError."""
    if found is None:
        raise SignInRequiredError("expected an experimenter's API token, or to be signed in")
    return found


MaybeExperimenterDep = Annotated[Principal | None, Depends(optional_experimenter)]
ExperimenterDep = Annotated[Principal, Depends(experimenter)]


def set_cookie(
    response: Response, app: AppContext, name: str, value: str, *, max_age: int | None = None
) -> None:
    response.set_cookie(
        name,
        value,
        max_age=max_age,
        httponly=True,
        samesite="lax",
        secure=app.settings.secure_cookies,
    )


def form_token(request: Request) -> str:
    """What a form sent from our own page carries: bound to the sign-in, or to a cookie before it.

    Sign-in tokens are random and secret, so a hash of one can be known to the page alone.
    """
    secret = request.cookies.get(SIGN_IN_COOKIE) or request.cookies.get(FORM_COOKIE) or ""
    return hashlib.sha256(f"form:{secret}".encode()).hexdigest()


def check_form_token(request: Request, given: str) -> None:
    """Raises ForbiddenError unless the form came from our own page."""
    has_secret = SIGN_IN_COOKIE in request.cookies or FORM_COOKIE in request.cookies
    expected = form_token(request).encode()
    if not has_secret or not hmac.compare_digest(expected, given.encode(errors="replace")):
        raise ForbiddenError("this form is out of date: go back, reload the page and send it again")


def new_form_secret() -> str:
    return secrets.token_urlsafe(16)
