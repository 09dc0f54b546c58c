"""The addresses at which a study's pages are served: one for each mode of a session.

`/s/SLUG` is for those who take part. `/preview/s/SLUG` serves the same pages to experimenters of
the study alone, and `/pilot/s/SLUG` to those who have the link of its pilot. Each has cookies of
its own, so that a participant's link begins a session of its own in a browser with a preview.
"""

from __future__ import annotations

from fastapi import Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders

from app.services.arrival import pilot_links
from app.services.runtime.errors import ForbiddenError
from app.services.studies import access, session_modes
from app.services.studies.access import Right

from .security import optional_experimenter, session_cookie, studio_of

#: What the address of a page begins with, and its cookie's name, for modes that are not live.
PREFIXES = {session_modes.PREVIEW: "/preview", session_modes.PILOT: pilot_links.PREFIX}

_SEPARATOR = "/"
#: The cookies that a study's pages have, `pbpo_KIND_SLUG`: each mode has its own.
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
    """What a page's calls say in `PBPO-Study`: which cookie holds the session's token."""
    mode = mode_of(request)
    return slug if mode == session_modes.LIVE else f"{mode}{_SEPARATOR}{slug}"


def of_header(said: str) -> tuple[str, str]:
    """Mode and slug, from the value of `PBPO-Study`."""
    mode, separator, slug = said.rpartition(_SEPARATOR)
    return (mode, slug) if separator and mode in PREFIXES else (session_modes.LIVE, said)


async def require_admitted(request: Request, mode: str, slug: str) -> None:
    """Raises ForbiddenError where a preview is asked for by anybody but its experimenters.

    It is asked with each request: a preview ends with the experimenter's sign-out.
    """
    if mode != session_modes.PREVIEW:
        return
    app = studio_of(request)
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


def take_in(request: Request, mode: str, slug: str) -> None:
    """Let the pages find the cookies of this mode where they look for those of a live session."""
    if mode == session_modes.LIVE:
        return
    cookies = request.cookies
    for name in (f"pbpo_{kind}_{slug}" for kind in _OF_A_STUDY):
        cookies.pop(name, None)
        if own := cookies.get(_renamed(name, mode)):
            cookies[name] = own


def send_out(response: Response, mode: str, slug: str) -> None:
    """Put the cookie and the redirects of a page under the address of this mode."""
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
