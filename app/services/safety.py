"""What must be right before studies are served to people, said in sentences.

What would let strangers in is refused; what is merely less safe than it could be is said.
"""

from __future__ import annotations

import ipaddress
import stat
from collections.abc import Iterator
from urllib.parse import urlsplit

from sqlalchemy.engine import make_url

from . import accounts, demo
from .errors import ConflictError
from .settings import Settings, misspelt_settings
from .studio import Studio, require_queue

#: Bits of a folder's mode that let others than its owner in.
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def require_servable(settings: Settings, workers: int) -> None:
    """Raises ConflictError where so many processes would stand in each other's way."""
    if workers > 1 and make_url(settings.url).get_backend_name() == "sqlite":
        raise ConflictError(
            f"expected one worker on SQLite, which has one writer at a time, got {workers}: several"
            " need PostgreSQL (PBPO_DATABASE_URL)"
        )


def require_workers_apart(settings: Settings) -> None:
    """Raises ConflictError where servers leave nothing to workers, or workers cannot do it."""
    if not settings.workers_apart:
        raise ConflictError(
            "expected PBPO_WORKERS_APART=true, for the worker as for the servers, got false:"
            " servers do without workers then"
        )
    require_queue()


def require_safe(studio: Studio, host: str) -> None:
    """Raises ConflictError where everybody could know how to sign in.

    In production also for each setting that is less safe than it could be.
    """
    said = list(unsafe_settings(studio, host)) if studio.settings.production else []
    if said:
        raise ConflictError(
            " ".join(["in production (PBPO_PRODUCTION) this is not served:", *said])
        )
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
    if not settings.secure_cookies and (settings.production or not _is_loopback(host)):
        yield (
            "Cookies would also be sent over plain HTTP, where others can listen: serve behind TLS,"
            " and set PBPO_SECURE_COOKIES=true."
        )
    mode = settings.data_dir.stat().st_mode
    if mode & _OTHERS:
        yield (
            f"Other users of this machine can look into {settings.data_dir}, where the answers"
            f" are: chmod 700 {settings.data_dir}"
        )
    store = urlsplit(studio.recordings.origin or "")
    if store.scheme == "http" and (settings.production or not _is_loopback(store.hostname or "")):
        yield (
            "Links to videos would be sent over plain HTTP, where others can read them: give the"
            " store of recordings an https address (PBPO_S3_ENDPOINT, PBPO_S3_PUBLIC_ENDPOINT)."
        )
    access = settings.data_dir / demo.ACCESS_FILE
    if access.exists():
        yield f"{access} holds the demo's password and is of no more use: delete it."
    for folder in (settings.media_dir, settings.own_videos):
        if folder.exists() and folder.stat().st_mode & stat.S_IWOTH:
            yield (
                f"Every user of this machine can put other videos into {folder}: chmod o-w {folder}"
            )
    if settings.ledger_path.exists() and settings.ledger_path.stat().st_mode & _OTHERS:
        yield (
            f"Other users of this machine can read or write {settings.ledger_path}:"
            f" chmod 600 {settings.ledger_path}"
        )
    for name, meant in misspelt_settings():
        yield f"{name} is no setting, and has no effect: {meant} may be meant."


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
