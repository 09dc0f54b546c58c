"""The addresses at which a study's pages are served: one for each mode of a session.

`/s/SLUG` is for those who take part. `/preview/s/SLUG` serves the same pages to experimenters of
the study alone. Each has a cookie of its own, so that a participant's link that is opened in a
browser with a preview begins a session of its own.
"""

from __future__ import annotations

from fastapi import Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders

from app.services import access, modes
from app.services.access import Right
from app.services.errors import ForbiddenError

from .security import optional_experimenter, session_cookie, studio_of

#: What the address of a page begins with, and its cookie's name, for modes that are not live.
PREFIXES = {modes.PREVIEW: "/preview"}

_SEPARATOR = "/"


def mode_of(request: Request) -> str:
    """The mode of the sessions that this address is for."""
    path = request.url.path
    for mode, prefix in PREFIXES.items():
        if path.startswith(f"{prefix}/s/"):
            return mode
    return modes.LIVE


def base_of(request: Request, slug: str) -> str:
    """The address of the study's first page, in the mode of this request."""
    return f"{PREFIXES.get(mode_of(request), '')}/s/{slug}"


def study_header(request: Request, slug: str) -> str:
    """What a page's calls say in `PBPO-Study`: which cookie holds the session's token."""
    mode = mode_of(request)
    return slug if mode == modes.LIVE else f"{mode}{_SEPARATOR}{slug}"


def of_header(said: str) -> tuple[str, str]:
    """Mode and slug, from the value of `PBPO-Study`."""
    mode, separator, slug = said.rpartition(_SEPARATOR)
    return (mode, slug) if separator and mode in PREFIXES else (modes.LIVE, said)


async def require_admitted(request: Request, mode: str, slug: str) -> None:
    """Raises ForbiddenError where a preview is asked for by anybody but its experimenters.

    It is asked with each request: a preview ends with the experimenter's sign-out.
    """
    if mode != modes.PREVIEW:
        return
    studio = studio_of(request)
    caller = await optional_experimenter(request, studio, request.headers.get("authorization"))
    may = caller is not None and await run_in_threadpool(
        access.may, studio, caller, slug, Right.CHANGE
    )
    if not may:
        raise ForbiddenError(
            f"expected an experimenter of {slug!r} who is signed in: a preview is for nobody else"
        )


def cookie_of(mode: str, slug: str) -> str:
    """The name of the cookie that holds the token of a session in this mode."""
    return session_cookie(slug) if mode == modes.LIVE else f"pbpo_{mode}_{slug}"


def take_in(request: Request, mode: str, slug: str) -> None:
    """Let the pages find the cookie of this mode where they look for a session's."""
    if mode == modes.LIVE:
        return
    cookies = request.cookies
    cookies.pop(session_cookie(slug), None)
    if own := cookies.get(cookie_of(mode, slug)):
        cookies[session_cookie(slug)] = own


def send_out(response: Response, mode: str, slug: str) -> None:
    """Put the cookie and the redirects of a page under the address of this mode."""
    if mode == modes.LIVE:
        return
    here, cookie = f"/s/{slug}", f"{session_cookie(slug)}="
    headers = MutableHeaders(raw=response.raw_headers)
    location = headers.get("location", "")
    if location == here or location.startswith((f"{here}?", f"{here}/")):
        headers["location"] = f"{PREFIXES[mode]}{location}"
    for index, (name, value) in enumerate(response.raw_headers):
        if name == b"set-cookie" and value.startswith(cookie.encode("latin-1")):
            renamed = f"{cookie_of(mode, slug)}=".encode("latin-1") + value[len(cookie) :]
            response.raw_headers[index] = (name, renamed)
