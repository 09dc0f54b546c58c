"""Puts the `__Host-` prefix on every cookie of the application wherever cookies are secure.

A browser accepts a cookie with this prefix only over HTTPS and from this very host, so no other
host of the same site can plant one. Within the application cookies have their plain names: the
middleware adds the prefix to responses and removes it from requests. Cookies of the application
that come without the prefix are dropped.
"""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext

PREFIX = "__Host-"
_OURS = b"pbpo_"
_PREFIX = PREFIX.encode("latin-1")

_Header = tuple[bytes, bytes]


class HostCookies:
    """Adds and removes the prefix, where the studio's settings make cookies secure."""

    def __init__(self, asgi_app: ASGIApp) -> None:
        self._app = asgi_app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not _is_secure(scope):
            await self._app(scope, receive, send)
            return
        scope["headers"] = [_received(header) for header in scope["headers"]]

        async def send_prefixed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [_sent(header) for header in message.get("headers", ())]
            await send(message)

        await self._app(scope, receive, send_prefixed)


def _is_secure(scope: Scope) -> bool:
    app: AppContext = scope["app"].state.app
    return app.settings.secure_cookies


def _received(header: _Header) -> _Header:
    name, value = header
    if name != b"cookie":
        return header
    cookies = [cookie.strip() for cookie in value.split(b";")]
    kept = [cookie.removeprefix(_PREFIX) for cookie in cookies if not cookie.startswith(_OURS)]
    return name, b"; ".join(kept)


def _sent(header: _Header) -> _Header:
    name, value = header
    if name.lower() != b"set-cookie" or not value.startswith(_OURS):
        return header
    # Deletions as well: a browser accepts no cookie of this name without it.
    secure = b"" if b"; secure" in value.lower() else b"; Secure"
    return name, _PREFIX + value + secure
