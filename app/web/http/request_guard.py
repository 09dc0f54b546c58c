"""Checks that every request passes before routing, and headers that every response carries."""

from __future__ import annotations

from fastapi.responses import Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext

from . import public_address
from .problems import Kind, problem
from .security import POLICY, content_security_policy

_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
#: Values of `Sec-Fetch-Site` with which a request may change something: own pages, and requests no
#: page sent. `same-site` would include every other host of a university.
_OWN_SITES = frozenset({"same-origin", "none"})

#: Headers of every response, unless its route sets them.
_HEADERS = (
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "same-origin"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Permissions-Policy", "camera=(), microphone=(), geolocation=()"),
)
#: With TLS: browsers use only HTTPS for this host, for a year.
_BY_HTTPS = ("Strict-Transport-Security", "max-age=31536000")


class Guard:
    """Refuses state-changing requests from other sites, and sets the security headers."""

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
            refusal = refusal_response(scope["path"], 403, "This request came from another site.")
            await refusal(scope, receive, send_with_headers)
            return

        if "\0" in scope["path"]:
            # No route or name contains NUL, and PostgreSQL refuses it in a query.
            nothing = refusal_response(scope["path"], 404, "There is nothing at this address.")
            await nothing(scope, receive, send_with_headers)
            return

        await self._app(scope, receive, send_with_headers)


def _is_of_another_site(scope: Scope) -> bool:
    """Whether the browser's headers name another site. Programs send none of them, and no cookies.

    Browsers send `Sec-Fetch-Site` over HTTPS and to localhost; older ones do not. All of them send
    `Origin` with requests that change something.
    """
    headers = Headers(scope=scope)
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site is not None:
        return site not in _OWN_SITES
    if origin is None:
        return False
    app: AppContext = scope["app"].state.app
    return not public_address.is_own_origin(scope, app.settings, origin)


def refusal_response(path: str, status: int, detail: str) -> Response:
    """The response to a request refused before routing: a problem for the API, else plain text."""
    if path.startswith("/api/"):
        kinds = {
            403: Kind(403, "forbidden", "Not allowed"),
            404: Kind(404, "not-found", "Not found"),
            414: Kind(414, "address-too-long", "The address is too long"),
            431: Kind(431, "headers-too-long", "The headers are too long"),
        }
        return problem(kinds[status], detail)
    return Response(detail, status, media_type="text/plain")
