"""What is asked of every request and said with every answer, before any route is found."""

from __future__ import annotations

from fastapi.responses import Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext

from . import public_address
from .problems import Kind, problem
from .security import POLICY, content_security_policy

_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
#: Whose requests may change something: our own pages', and those that no page sent. Of a site such
#: as a university's any other host would be `same-site`.
_OWN_SITES = frozenset({"same-origin", "none"})

#: What every response says unless its route says otherwise.
_HEADERS = (
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "same-origin"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Permissions-Policy", "camera=(), microphone=(), geolocation=()"),
)
#: Where TLS is: for a year a browser comes to this name by HTTPS alone, whatever a link says.
_BY_HTTPS = ("Strict-Transport-Security", "max-age=31536000")


class Guard:
    """Refuses forms sent by other sites, and tells browsers how little our pages need."""

    def __init__(self, asgi_app: ASGIApp) -> None:
        self._app = asgi_app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                app: AppContext = scope["app"].state.app
                headers.setdefault(POLICY, content_security_policy(app.recordings.origin))
                for name, value in _HEADERS:
                    headers.setdefault(name, value)
                if "location" in headers:
                    headers["location"] = public_address.within(headers["location"], scope)
                if app.settings.secure_cookies:
                    headers.setdefault(*_BY_HTTPS)
            await send(message)

        if scope["method"] not in _SAFE_METHODS and _is_of_another_site(scope):
            refusal = turned_away(scope["path"], 403, "This request came from another site.")
            await refusal(scope, receive, send_with_headers)
            return

        if "\0" in scope["path"]:
            # No name of ours holds one, and PostgreSQL cannot even be asked for it.
            nothing = turned_away(scope["path"], 404, "There is nothing at this address.")
            await nothing(scope, receive, send_with_headers)
            return

        await self._app(scope, receive, send_with_headers)


def _is_of_another_site(scope: Scope) -> bool:
    """By what the browser says. Programs say nothing of this, and bring no cookies.

    Browsers say `Sec-Fetch-Site` over HTTPS and to localhost, and the older ones not at all; with
    what changes something they have long since sent `Origin`.
    """
    headers = Headers(scope=scope)
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site is not None:
        return site not in _OWN_SITES
    if origin is None:
        return False
    app: AppContext = scope["app"].state.app
    return not public_address.is_own_origin(scope, app.settings, origin)


def turned_away(path: str, status: int, detail: str) -> Response:
    """At the door: a problem for programs, as from within, and a plain sentence for people."""
    if path.startswith("/api/"):
        kinds = {
            403: Kind(403, "forbidden", "Not allowed"),
            404: Kind(404, "not-found", "Not found"),
            414: Kind(414, "address-too-long", "The address is too long"),
            431: Kind(431, "headers-too-long", "The headers are too long"),
        }
        return problem(kinds[status], detail)
    return Response(detail, status, media_type="text/plain")
