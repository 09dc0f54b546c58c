"""Cookies of an evaluator's browser: a check that it keeps any, and the lifetime of the session's.

A session begins only once the browser has returned a cookie: where cookies are blocked, each press
would begin another session and use up a place or a personal link.
"""

from __future__ import annotations

from datetime import timedelta
from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import RedirectResponse, Response

from app.services.arrival import session_holder
from app.services.context import AppContext
from app.services.runtime.ids import is_secret, new_secret, secret_hash
from app.web.http import session_paths
from app.web.http.security import SESSION_COOKIE_SECONDS, session_cookie, set_cookie

#: Shows that the browser keeps cookies, and binds to it the form that begins a session: a random
#: value that is stored nowhere else and goes when the browser is closed.
_KEEPS = "pbpo_keeps_cookies"
#: Parameter of the address to which a form was redirected with the cookie, to test its return.
_SENT_ON = "cookie"
#: For how long after the end the browser that came to it is shown the receipt, in seconds.
_RECEIPT_SECONDS = 600


def show_that_kept(request: Request, app: AppContext, response: Response) -> Response:
    """Set the test cookie on a page whose form begins a session."""
    if not is_secret(secret_of(request)):
        set_cookie(response, app, _KEEPS, new_secret())
    return response


def secret_of(request: Request) -> str:
    """The random value that distinguishes this browser's forms from those of others."""
    return request.cookies.get(_KEEPS, "")


def are_kept(request: Request, slug: str) -> bool:
    """Whether the browser has returned a cookie."""
    return _KEEPS in request.cookies or session_cookie(slug) in request.cookies


def sent_on(request: Request, app: AppContext) -> Response | None:
    """A redirect of the form with a test cookie; None if the form was already redirected."""
    if _SENT_ON in request.query_params:
        return None
    query = urlencode([*request.query_params.multi_items(), (_SENT_ON, "asked")])
    response = RedirectResponse(f"{request.url.path}?{query}", status_code=307)
    return show_that_kept(request, app, response)


def way_in(request: Request, slug: str) -> str:
    """The study's address with the parameters of the entry link."""
    query = urlencode([pair for pair in request.query_params.multi_items() if pair[0] != _SENT_ON])
    base = session_paths.base_of(request, slug)
    return f"{base}?{query}" if query else base


def keep_session(
    response: Response, app: AppContext, slug: str, token: str, entry: str | None = None
) -> None:
    """Set the session's cookie, and the one that records its personal link."""
    set_cookie(response, app, session_cookie(slug), token, max_age=SESSION_COOKIE_SECONDS)
    if entry is not None:
        name, value = _entry_cookie(slug), secret_hash(entry)
        set_cookie(response, app, name, value, max_age=SESSION_COOKIE_SECONDS)


def began_by(request: Request, slug: str, entry: str) -> bool:
    """Whether the browser's session began by this personal link."""
    return request.cookies.get(_entry_cookie(slug)) == secret_hash(entry)


def forget(response: Response, slug: str) -> Response:
    """Delete the browser's cookies of this study's session."""
    for name in (session_cookie(slug), _entry_cookie(slug), _ended_cookie(slug)):
        response.delete_cookie(name)
    return response


def has_ended(response: Response, app: AppContext, slug: str, token: str) -> None:
    """Keep the session's cookie for a day after the end, so that the receipt can be shown again."""
    _keep_for(response, app, slug, token, session_holder.KEPT_AFTER_END)
    set_cookie(response, app, _ended_cookie(slug), "1", max_age=_RECEIPT_SECONDS)


def still_has_ended(
    request: Request, response: Response, app: AppContext, slug: str, token: str
) -> None:
    """On a page of the end: set the cookie's lifetime to the rest of the day since then."""
    until = session_holder.kept_until(app, slug, token)
    if until is None:
        return
    _keep_for(response, app, slug, token, until - app.now())
    if _ended_cookie(slug) in request.cookies and not _came_from_own_page(request):
        response.delete_cookie(_ended_cookie(slug))


def shows_receipt(request: Request, slug: str, *, has_ended: bool) -> bool:
    """Whether this page may show the receipt: the session's person has just navigated to it.

    A request by a link or a typed address may come from the next person at a shared computer. After
    the end, a browser that sends no Referer is shown the receipt once.
    """
    from_elsewhere = request.headers.get("sec-fetch-site", "same-origin") != "same-origin"
    return not from_elsewhere and (not has_ended or _ended_cookie(slug) in request.cookies)


def _keep_for(response: Response, app: AppContext, slug: str, token: str, time: timedelta) -> None:
    seconds = max(1, int(time.total_seconds()))
    set_cookie(response, app, session_cookie(slug), token, max_age=seconds)


def _came_from_own_page(request: Request) -> bool:
    return request.headers.get("sec-fetch-site") == "same-origin"


def _entry_cookie(slug: str) -> str:
    return f"pbpo_entry_{slug}"


def _ended_cookie(slug: str) -> str:
    return f"pbpo_ended_{slug}"
