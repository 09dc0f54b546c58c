"""Browsers in which an account has signed in before, recognised by a signed cookie.

The cookie authenticates no one. It exempts this browser from the delays that wrong passwords from
elsewhere cause. It is valid for one account; its name and value do not reveal the address.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from ipaddress import ip_address, ip_network

from fastapi import Request, Response

from app.services.accounts.accounts import normal
from app.services.accounts.login_rate_limit import CameFrom
from app.services.context import AppContext
from app.web.http.security import set_cookie

_PURPOSE = "known device"
_LASTS_S = 400 * 24 * 3600
#: Addresses of one network: of a provider's customer, or of its neighbours.
_IPV4_PREFIX, _IPV6_PREFIX = 24, 48


def came_from(request: Request, app: AppContext, email: str) -> CameFrom:
    """The network of this request, and whether this browser is known for this account."""
    host = request.client.host if request.client is not None else ""
    return CameFrom(network_of(host), _device(request, app, email))


def network_of(host: str) -> str:
    """The network of an IP address; any other name is returned as it is."""
    try:
        address = ip_address(host)
    except ValueError:
        return host
    mapped = getattr(address, "ipv4_mapped", None)
    address = mapped or address
    prefix = _IPV4_PREFIX if address.version == 4 else _IPV6_PREFIX
    return str(ip_network((address, prefix), strict=False))


def remember(request: Request, response: Response, app: AppContext, email: str) -> None:
    """Set the cookie that recognises this browser for this account."""
    device = _device(request, app, email) or secrets.token_urlsafe(12)
    value = f"{device}.{_signed(app, email, device)}"
    set_cookie(response, app, _name(app, email), value, max_age=_LASTS_S)


def _device(request: Request, app: AppContext, email: str) -> str | None:
    device, _, signature = request.cookies.get(_name(app, email), "").rpartition(".")
    expected = _signed(app, email, device).encode()
    is_ours = hmac.compare_digest(expected, signature.encode(errors="replace"))
    return device if device and is_ours else None


def _name(app: AppContext, email: str) -> str:
    return f"pbpo_device_{_signed(app, email, '')[:12]}"


def _signed(app: AppContext, email: str, device: str) -> str:
    told = f"{device}\0{normal(email)}".encode(errors="replace")
    return hmac.new(app.secret.key(_PURPOSE), told, hashlib.sha256).hexdigest()
