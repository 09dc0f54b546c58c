"""The addresses of a study's pages: one for each mode of a session.

`/s/SLUG` is for participants. `/preview/s/SLUG` serves the same pages to experimenters of the study
only, and `/pilot/s/SLUG` to holders of its pilot link. Each mode has cookies of its own, so that a
participant's link begins a separate session in a browser that has a preview.
"""

from __future__ import annotations

from fastapi import Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders

from app.services.arrival import pilot_links, preview_tokens
from app.services.runtime.errors import ForbiddenError
from app.services.studies import access, session_modes
from app.services.studies.access import Right

from .security import app_context_of, optional_experimenter, session_cookie

#: The prefix of a page's address, for modes other than live.
PREFIXES = {session_modes.PREVIEW: "/preview", session_modes.PILOT: pilot_links.PREFIX}

_SEPARATOR = "/"
#: Kinds of cookies of a study's pages, `pbpo_KIND_SLUG`: each mode has its own.
_OF_A_STUDY = ("session", "entry", "ended", "deleted")


def mode_of(request: Request) -> str:
    """The mode of the sessions that this address is for."""
    path = request.url.path
    for mode, prefix in PREFIXES.items():
        if path.startswith(f"{prefix}/s/"):
            return mode
    return session_modes.LIVE


def base_of(request: Request, slug: str) -> str:
    """The address of the study's first page, in the mode of this request."""
    return f"{PREFIXES.get(mode_of(request), '')}/s/{slug}"


def study_header(request: Request, slug: str) -> str:
    """The value of `PBPO-Study` in a page's calls; it selects the session's cookie."""
    mode = mode_of(request)
    return slug if mode == session_modes.LIVE else f"{mode}{_SEPARATOR}{slug}"


def of_header(said: str) -> tuple[str, str]:
    """Mode and slug, from the value of `PBPO-Study`."""
    mode, separator, slug = said.rpartition(_SEPARATOR)
    return (mode, slug) if separator and mode in PREFIXES else (session_modes.LIVE, said)


async def require_admitted(request: Request, mode: str, slug: str) -> None:
    """Raises ForbiddenError if a preview is requested by anyone but the study's experimenters.

    It is checked at each request: a preview ends with the experimenter's sign-out.
    """
    if mode != session_modes.PREVIEW:
        return
    app = app_context_of(request)
    caller = await optional_experimenter(request, app, request.headers.get("authorization"))
    may = caller is not None and await run_in_threadpool(
        access.may, app, caller, slug, Right.CHANGE
    )
    if not may:
        raise ForbiddenError(
            f"expected an experimenter of {slug!r} who is signed in: a preview is for nobody else"
        )


def cookie_of(mode: str, slug: str) -> str:
    """The name of the cookie that holds the token of a session in this mode."""
    return _renamed(session_cookie(slug), mode)


async def cookie_token(request: Request, mode: str, slug: str) -> str | None:
    """The token in this mode's cookie. The token of a preview counts at addresses of previews only.

    Other addresses check no sign-in, and a cookie can be written by hand.
    """
    token = request.cookies.get(cookie_of(mode, slug))
    if token is None or mode == session_modes.PREVIEW:
        return token
    app = app_context_of(request)
    if preview_tokens.is_other(app, token):
        return token
    is_preview = await run_in_threadpool(preview_tokens.is_preview, app, token)
    return None if is_preview else token


async def read_mode_cookies(request: Request, mode: str, slug: str) -> None:
    """Rename this mode's cookies in the request to those of a live session, which pages read."""
    cookies = request.cookies
    if await cookie_token(request, mode, slug) is None:
        cookies.pop(cookie_of(mode, slug), None)
    if mode == session_modes.LIVE:
        return
    for name in (f"pbpo_{kind}_{slug}" for kind in _OF_A_STUDY):
        cookies.pop(name, None)
        if own := cookies.get(_renamed(name, mode)):
            cookies[name] = own


def write_mode_cookies(response: Response, mode: str, slug: str) -> None:
    """Rename the response's cookies to those of this mode, and prefix its redirects accordingly."""
    if mode == session_modes.LIVE:
        return
    here = f"/s/{slug}"
    headers = MutableHeaders(raw=response.raw_headers)
    location = headers.get("location", "")
    if location == here or location.startswith((f"{here}?", f"{here}/")):
        headers["location"] = f"{PREFIXES[mode]}{location}"
    ours = {f"pbpo_{kind}_{slug}" for kind in _OF_A_STUDY}
    for index, (name, value) in enumerate(response.raw_headers):
        cookie, equals, rest = value.decode("latin-1").partition("=")
        if name == b"set-cookie" and cookie in ours:
            renamed = f"{_renamed(cookie, mode)}{equals}{rest}"
            response.raw_headers[index] = (name, renamed.encode("latin-1"))


def _renamed(name: str, mode: str) -> str:
    return name if mode == session_modes.LIVE else name.replace("pbpo_", f"pbpo_{mode}_", 1)
