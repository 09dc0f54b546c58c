"""The studio's own address: in links that people are given, and as the origin of its forms."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import Request
from starlette.datastructures import Headers
from starlette.types import Scope

from app.services.runtime.settings import Settings

from .security import studio_of

_PORTS = {"http": 80, "https": 443}


def base_url(request: Request) -> str:
    """What links begin with: PBPO_PUBLIC_URL; without it, what the browser has asked for."""
    return studio_of(request).settings.public_url or str(request.base_url).rstrip("/")


def is_own_origin(scope: Scope, settings: Settings, origin: str) -> bool:
    """Whether a form with this `Origin` was sent by a page of the host that it was sent to.

    Behind TLS a server may be asked by plain HTTP, so https is taken in place of http.
    """
    sent_by = _origin(origin)
    if sent_by is None:
        return False
    host = Headers(scope=scope).get("host", "")
    schemes = {scope["scheme"], "https"}
    own = {_origin(f"{scheme}://{host}") for scheme in schemes} | {_origin(settings.public_url)}
    return sent_by in own


def within(location: str, scope: Scope) -> str:
    """A redirect to our own host as a path: a `Host` that somebody made up leads nobody away."""
    host = Headers(scope=scope).get("host", "")
    for scheme in _PORTS:
        start = f"{scheme}://{host}/"
        if host and location.startswith(start):
            # Not more than one slash: two would begin the name of another host.
            return "/" + location[len(start) :].lstrip("/\\")
    return location


def _origin(url: str) -> tuple[str, str, int] | None:
    """Scheme, host and port; None of what is no origin, such as `null`."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        return None
    if parts.scheme not in _PORTS or not parts.hostname:
        return None
    return parts.scheme, parts.hostname, port or _PORTS[parts.scheme]
