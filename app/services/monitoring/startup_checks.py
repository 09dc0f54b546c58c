"""Checks of the configuration before a server starts.

A configuration that would let strangers in is refused; one that is merely less safe than it could
be causes warnings, and is refused in production.
"""

from __future__ import annotations

import ipaddress
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

from sqlalchemy.engine import URL, make_url

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.runtime.optional_packages import require_queue
from app.services.runtime.settings import Settings, misspelt_settings
from app.services.studies import demo

#: Permission bits of group and others.
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
#: Values of PostgreSQL's `sslmode` that guarantee encryption.
_ENCRYPTED = frozenset({"require", "verify-ca", "verify-full"})


def require_servable(settings: Settings, workers: int) -> None:
    """Raise ConflictError if this number of processes cannot share the database (SQLite)."""
    if workers > 1 and make_url(settings.url).get_backend_name() == "sqlite":
        raise ConflictError(
            f"expected one worker on SQLite, which has one writer at a time, got {workers}: several"
            " need PostgreSQL (PBPO_DATABASE_URL)"
        )


def require_workers_apart(settings: Settings) -> None:
    """Raise ConflictError if PBPO_WORKERS_APART is off, or the queue's package is missing."""
    if not settings.workers_apart:
        raise ConflictError(
            "expected PBPO_WORKERS_APART=true, for the worker as for the servers, got false:"
            " servers do without workers then"
        )
    require_queue()


def require_safe(app: AppContext, host: str) -> None:
    """Raise ConflictError if the demo account, whose password is in a file, is enabled.

    In production, also for every unsafe setting.
    """
    said = list(unsafe_settings(app, host)) if app.settings.production else []
    if said:
        raise ConflictError(
            " ".join(["in production (PBPO_PRODUCTION) this is not served:", *said])
        )
    with app.database.read() as db:
        account = accounts.by_address(db, demo.EMAIL)
    if account is not None and account.disabled_at is None:
        raise ConflictError(
            f"expected no demo account where studies are served, and {demo.EMAIL} can sign in with"
            f" the password in {demo.ACCESS_FILE}: make an admin of your own (pbpo account create"
            f" EMAIL --role admin), and then disable it (pbpo account disable {demo.EMAIL})"
        )


def unsafe_settings(app: AppContext, host: str) -> Iterator[str]:
    """The unsafe settings, each as a sentence that says what to do."""
    settings = app.settings
    if not settings.secure_cookies and (settings.production or not _is_loopback(host)):
        yield (
            "Cookies would also be sent over plain HTTP, where others can listen: serve behind TLS,"
            " and set PBPO_SECURE_COOKIES=true."
        )
    if settings.production and os.geteuid() == 0:
        yield (
            "It runs as root, and whoever took it over would have the whole machine: run it as a"
            " user of its own."
        )
    if settings.production and not settings.public_url.startswith("https://"):
        yield (
            "Links to invitations and studies would begin with whatever host a request names: set"
            " PBPO_PUBLIC_URL to the https address at which people reach the studio."
        )
    mode = settings.data_dir.stat().st_mode
    if mode & _OTHERS:
        yield (
            f"Other users of this machine can look into {settings.data_dir}, where the answers"
            f" are: chmod 700 {settings.data_dir}"
        )
    yield from _unsafe_database(settings)
    store = urlsplit(app.recordings.origin or "")
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
    if settings.deletion_log_path.exists() and settings.deletion_log_path.stat().st_mode & _OTHERS:
        yield (
            f"Other users of this machine can read or write {settings.deletion_log_path}:"
            f" chmod 600 {settings.deletion_log_path}"
        )
    for name, meant in misspelt_settings():
        yield f"{name} is no setting, and has no effect: {meant} may be meant."


def _unsafe_database(settings: Settings) -> Iterator[str]:
    url = make_url(settings.url)
    if url.get_backend_name() != "sqlite":
        for host in _reached_in_the_clear(url):
            yield (
                f"Answers would go to and from {host} in the clear, where others can read them: add"
                " sslmode=require, or better sslmode=verify-full, to PBPO_DATABASE_URL."
            )
        return
    file = Path(url.database or "").resolve()
    # A SQLite file in the data folder is covered by the check of that folder.
    if file.is_relative_to(settings.data_dir.resolve()) or not file.is_file():
        return
    if file.stat().st_mode & _OTHERS and file.parent.stat().st_mode & _OTHERS:
        yield (
            f"Other users of this machine can look into {file}, where the answers are:"
            f" chmod 600 {file}*"
        )


def _reached_in_the_clear(url: URL) -> Iterator[str]:
    """The hosts of the URL that PostgreSQL may be reached on without TLS."""
    if (url.query.get("sslmode") or os.environ.get("PGSSLMODE")) in _ENCRYPTED:
        return
    named = url.query.get("host", ())
    hosts = [url.host or "", *(named.split(",") if isinstance(named, str) else named)]
    for host in hosts:
        # Each host can have its own port.
        name = host.partition(":")[0] if host.count(":") == 1 else host
        # A socket is local, and a name without a dot is a container in a private network.
        is_far = not name.startswith("/") and ("." in name or ":" in name)
        if is_far and not _is_loopback(name):
            yield name


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
