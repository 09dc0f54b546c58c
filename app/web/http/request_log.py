"""Gives each request an id, a line in the log and an entry in the metrics.

The line has the route's pattern, not the requested path: a path may contain an invitation, and a
query string a participant's id at a recruitment platform.
"""

from __future__ import annotations

import logging
import re
import secrets
import time

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADER = "X-Request-ID"

#: Accepted form of a proxy's id: other characters could break or forge a line of the log.
_SANE = re.compile(r"[A-Za-z0-9._-]{8,64}")

#: Requested every few seconds by monitors: only failures are logged.
_BY_MACHINES = frozenset({"/healthz", "/readyz", "/metrics"})

_KNOWN_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})

log = logging.getLogger(__name__)


class RequestLog:
    """Assigns the request id, and logs status and duration of each response."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(HEADER, "")
        request_id = given if _SANE.fullmatch(given) else secrets.token_hex(8)
        begun = time.perf_counter()
        status, seconds = 500, None

        async def send_with_id(message: Message) -> None:
            nonlocal status, seconds
            if message["type"] == "http.response.start":
                status, seconds = message["status"], time.perf_counter() - begun
                MutableHeaders(scope=message)[HEADER] = request_id
            await send(message)

        # Every request runs in its own context, so the binding ends with the request.
        structlog.contextvars.clear_contextvars()
        structlog.contextvars.bind_contextvars(request_id=request_id)
        try:
            await self._app(scope, receive, send_with_id)
        finally:
            if seconds is None:
                seconds = time.perf_counter() - begun
            self._tell(scope, status, seconds)

    def _tell(self, scope: Scope, status: int, seconds: float) -> None:
        method = scope["method"] if scope["method"] in _KNOWN_METHODS else "other"
        route = _pattern(scope)
        scope["app"].state.app.metrics.request(method, route, status, seconds)
        if status < 500 and route in _BY_MACHINES:
            return
        log.info(
            "request",
            extra={
                "method": method,
                "route": route,
                "status": status,
                "ms": round(1e3 * seconds, 1),
            },
        )


def _pattern(scope: Scope) -> str:
    """The pattern of the route that answered: one of few, whatever path was requested."""
    if scope["path"].startswith("/static/"):
        return "/static"
    # A nested router knows only its part of the pattern; FastAPI has the whole one in the scope.
    whole = scope.get("fastapi", {}).get("effective_route_context")
    route = whole or scope.get("route")
    return str(getattr(route, "path", "none")) or "none"
