"""Answers HEAD wherever GET is answered, as RFC 9110 wants it: the same headers, and no body.

The route for GET runs, its reader is gone once its headers are sent, and no cookie is set. On pages
that people enter by, the link's parameters and cookies are left out: a link preview does not enter.
"""

from __future__ import annotations

from collections.abc import Mapping

from starlette.responses import Response
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .session_paths import PREFIXES

#: In the scope of a request that is answered without a body.
IS_HEAD = "pbpo.is_head"
_ENTRANCES = tuple(f"{prefix}/s/" for prefix in ("", *PREFIXES.values()))


def headers_alone(headers: Mapping[str, str]) -> Response:
    """A response of these headers, for a body that is long or has consequences when it is read."""
    response = Response(headers=dict(headers))
    del response.headers["content-length"]
    return response


class HeadRequests:
    """Turns HEAD into GET where no route answers HEAD itself, and holds the body back."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD" or _is_answered(scope):
            await self._app(scope, receive, send)
            return
        asked = {**scope, "method": "GET", IS_HEAD: True}
        if scope["path"].startswith(_ENTRANCES):
            asked["query_string"] = b""
            asked["headers"] = [one for one in scope["headers"] if one[0] != b"cookie"]
        is_sent = False

        async def receive_until_sent() -> Message:
            return {"type": "http.disconnect"} if is_sent else await receive()

        async def send_without_body(message: Message) -> None:
            nonlocal is_sent
            if message["type"] == "http.response.start":
                headers = [one for one in message["headers"] if one[0] != b"set-cookie"]
                await send({**message, "headers": headers})
            elif not is_sent:
                is_sent = True
                await send({"type": "http.response.body", "body": b"", "more_body": False})

        try:
            await self._app(asked, receive_until_sent, send_without_body)
        finally:
            for key in ("route", "endpoint", "path_params", "fastapi"):
                if key in asked:
                    scope[key] = asked[key]


def _is_answered(scope: Scope) -> bool:
    return any(route.matches(scope)[0] is Match.FULL for route in scope["app"].routes)
