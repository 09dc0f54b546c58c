"""Limits on the size of requests: body (by route), address and headers.

A body is read no further than its limit, whatever its Content-Length. The limits fit what the
pages send: `LIMITS` is the one table, and the proxies in deploy/ have the same numbers.
"""

from __future__ import annotations

import re
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .request_guard import refusal_response
from .security import signed_in_now

#: The limit of every route that the table does not name, in bytes.
SMALL: Final = 64_000
#: A response with its events: a page sends 60 of them, an older page or a program more. The same
#: for a machine's numbers on a run.
WITH_EVENTS: Final = 600_000
#: All texts of a study in all its languages.
TEXTS: Final = 10_000_000

#: The longest body by path; None: the route counts the bytes itself, as uploads do.
LIMITS: Final[tuple[tuple[re.Pattern[str], int | None], ...]] = (
    (re.compile(r"/drafts(/[^/]+/files)?"), None),
    (re.compile(r"/drafts/[^/]+/(text|settings)"), TEXTS),
    (re.compile(r"/studies/[^/]+/texts"), TEXTS),
    (re.compile(r"/studies/[^/]+/desk/[^/]+/recording"), None),
    (re.compile(r"/api/v1/session/(responses|faults)"), WITH_EVENTS),
    (re.compile(r"/api/v1/studies/[^/]+/rollouts/[^/]+/recording"), None),
    (re.compile(r"/api/v1/studies/[^/]+/rollouts/[^/]+/measurements"), WITH_EVENTS),
)

#: The longest path with its query string, in bytes. Links of platforms are far shorter.
LONGEST_ADDRESS: Final = 8_000
#: All headers together, in bytes.
LONGEST_HEADERS: Final = 32_000
#: A form with more fields is refused after it is read: its separators are counted before.
MOST_FIELDS: Final = 1_000

_FORM = b"application/x-www-form-urlencoded"


def limit_of(path: str) -> int | None:
    """The largest body of a request to this path, in bytes; None if the route counts it itself."""
    return next((limit for pattern, limit in LIMITS if pattern.fullmatch(path)), SMALL)


class BodyLimit:
    """Answers 413, 414 or 431 to requests beyond the limits, before they fill the memory."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if too_long := _too_long(scope):
            await too_long(scope, receive, send)
            return
        limit = limit_of(scope["path"])
        if limit is None:
            await self._app(scope, receive, send)
            return
        await self._app(scope, _Limited(scope, receive, limit), send)


class _Limited:
    """Receives a body and counts it. Raises HTTPException once it is longer than the limit."""

    def __init__(self, scope: Scope, receive: Receive, limit: int) -> None:
        self._scope = scope
        self._receive = receive
        self._limit = limit
        headers = Headers(scope=scope)
        said = headers.get("content-length", "")
        self._said = int(said) if said.isdecimal() and len(said) < 20 else 0
        self._came = 0
        self._separators = 0
        self._is_form = headers.get("content-type", "").encode().startswith(_FORM)
        self._is_known = limit <= WITH_EVENTS

    async def __call__(self) -> Message:
        await self._hold(self._said)
        message = await self._receive()
        body = message.get("body", b"")
        self._came += len(body)
        await self._hold(self._came)
        if self._is_form:
            # The parser goes through separators one by one, for seconds where there are millions.
            self._separators += body.count(b"&")
            if self._separators >= MOST_FIELDS:
                raise HTTPException(400, f"Expected at most {MOST_FIELDS:,} fields")
        return message

    async def _hold(self, length: int) -> None:
        if length > SMALL and not self._is_known:
            # Long forms are accepted only url-encoded and from signed-in callers.
            if (
                not self._is_form
                or await run_in_threadpool(signed_in_now, Request(self._scope)) is None
            ):
                self._limit = SMALL
            self._is_known = True
        if length > self._limit:
            raise HTTPException(413, f"Expected at most {self._limit:,} bytes")


def _too_long(scope: Scope) -> Response | None:
    """The response to an address or headers beyond their limits; None if they are within."""
    path = scope["path"]
    address = len(scope.get("raw_path") or path) + len(scope["query_string"])
    if address > LONGEST_ADDRESS:
        said = f"Expected an address of at most {LONGEST_ADDRESS:,} bytes, got {address:,}."
        return refusal_response(path, 414, said)
    headers = sum(len(name) + len(value) for name, value in scope["headers"])
    if headers > LONGEST_HEADERS:
        said = f"Expected headers of at most {LONGEST_HEADERS:,} bytes, got {headers:,}."
        return refusal_response(path, 431, said)
    return None
