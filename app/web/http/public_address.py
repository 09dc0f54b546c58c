"""The application's own address: the base of links, and the origin of its forms."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import Request
from starlette.datastructures import Headers
from starlette.types import Scope

from app.services.runtime.settings import Settings

from .security import app_context_of

_PORTS = {"http": 80, "https": 443}


def base_url(request: Request) -> str:
    """The base of links: PBPO_PUBLIC_URL; without it, the base of the requested address.

    PBPO_ROOT_PATH is part of it.
    """
    settings = app_context_of(request).settings
    return settings.public_base or str(request.base_url).rstrip("/") + settings.root_path


def is_own_origin(scope: Scope, settings: Settings, origin: str) -> bool:
    """Whether this `Origin` is the host that the form was sent to.

    Behind TLS a server may receive plain HTTP, so the https origin is accepted in place of http.
    """
    sent_by = _origin(origin)
    if sent_by is None:
        return False
    host = Headers(scope=scope).get("host", "")
    schemes = {scope["scheme"], "https"}
    own = {_origin(f"{scheme}://{host}") for scheme in schemes} | {_origin(settings.public_url)}
    return sent_by in own


def within(location: str, scope: Scope) -> str:
    """Turn a redirect to the own host into a path: a forged `Host` cannot redirect elsewhere."""
    host = Headers(scope=scope).get("host", "")
    for scheme in _PORTS:
        start = f"{scheme}://{host}/"
        if host and location.startswith(start):
            # One slash only: two would begin the name of another host.
            return "/" + location[len(start) :].lstrip("/\\")
    return location


def _origin(url: str) -> tuple[str, str, int] | None:
    """Scheme, host and port; None for a value that is no origin, such as `null`."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        return None
    if parts.scheme not in _PORTS or not parts.hostname:
        return None
    return parts.scheme, parts.hostname, port or _PORTS[parts.scheme]
