"""Puts the `__Host-` prefix on every cookie of the application wherever cookies are secure.

Below a path of a host (PBPO_ROOT_PATH) every cookie is for that path alone, so that what else is
served there does not receive it. The prefix is `__Secure-` then: `__Host-` requires the path `/`.

A browser accepts a cookie with this prefix only over HTTPS and from this very host, so no other
host of the same site can plant one. Within the application cookies have their plain names: the
middleware adds the prefix to responses and removes it from requests. Cookies of the application
that come without the prefix are dropped.
"""

from __future__ import annotations

import re

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext

PREFIX = "__Host-"
PREFIX_BELOW_A_PATH = "__Secure-"
_OURS = b"pbpo_"
_WHOLE_HOST = re.compile(rb"; Path=/(?=;|$)", re.IGNORECASE)

_Header = tuple[bytes, bytes]


class HostCookies:
    """Adds and removes the prefix where cookies are secure, and narrows the path of cookies."""

    def __init__(self, asgi_app: ASGIApp) -> None:
        self._app = asgi_app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        app: AppContext = scope["app"].state.app
        root, is_secure = app.settings.root_path, app.settings.secure_cookies
        if scope["type"] != "http" or not (root or is_secure):
            await self._app(scope, receive, send)
            return
        prefix = (PREFIX_BELOW_A_PATH if root else PREFIX).encode() if is_secure else b""
        scope["headers"] = [_received(header, prefix) for header in scope["headers"]]

        async def send_prefixed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    _sent(header, prefix, root) for header in message.get("headers", ())
                ]
            await send(message)

        await self._app(scope, receive, send_prefixed)


def _received(header: _Header, prefix: bytes) -> _Header:
    name, value = header
    if name != b"cookie":
        return header
    cookies = [cookie.strip() for cookie in value.split(b";")]
    kept: dict[bytes, bytes] = {}
    for cookie in cookies:
        if not prefix or not cookie.startswith(_OURS):
            plain = cookie.removeprefix(prefix)
            # Browsers send the one of the longest path first: that is ours, not one of the host's.
            kept.setdefault(plain.partition(b"=")[0], plain)
    return name, b"; ".join(kept.values())


def _sent(header: _Header, prefix: bytes, root: str) -> _Header:
    name, value = header
    if name.lower() != b"set-cookie" or not value.startswith(_OURS):
        return header
    # Deletions as well: a browser accepts no cookie of this name without it.
    secure = b"" if b"; secure" in value.lower() else b"; Secure"
    if root:
        value = _WHOLE_HOST.sub(f"; Path={root}".encode(), value)
    return name, prefix + value + (secure if prefix else b"")
