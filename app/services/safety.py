"""What must be right before studies are served to people, said in sentences.

What would let strangers in is refused; what is merely less safe than it could be is said.
"""

from __future__ import annotations

import ipaddress
import stat
from collections.abc import Iterator

from . import accounts, demo
from .errors import ConflictError
from .studio import Studio

#: Bits of a folder's mode that let others than its owner in.
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def require_safe(studio: Studio) -> None:
    """Raises ConflictError where everybody could know how to sign in."""
    with studio.database.read() as session:
        account = accounts.by_address(session, demo.EMAIL)
    if account is not None and account.disabled_at is None:
        raise ConflictError(
            f"expected no demo account where studies are served, and {demo.EMAIL} can sign in with"
            f" the password in {demo.ACCESS_FILE}: make an admin of your own (pbpo account create"
            f" EMAIL --role admin), and then disable it (pbpo account disable {demo.EMAIL})"
        )


def unsafe_settings(studio: Studio, host: str) -> Iterator[str]:
    """Each setting that is less safe than it could be, in a sentence that says what to do."""
    settings = studio.settings
    if not settings.secure_cookies and not _is_loopback(host):
        yield (
            f"Cookies would also be sent over plain HTTP, and {host} can be reached from outside:"
            " serve behind TLS, and set PBPO_SECURE_COOKIES=true."
        )
    mode = settings.data_dir.stat().st_mode
    if mode & _OTHERS:
        yield (
            f"Other users of this machine can look into {settings.data_dir}, where the answers"
            f" are: chmod 700 {settings.data_dir}"
        )
    access = settings.data_dir / demo.ACCESS_FILE
    if access.exists():
        yield f"{access} holds the demo's password and is of no more use: delete it."


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
