"""Derives the server's keys from one random secret in the database.

The first process that opens the database creates the secret. All processes share it, and backups
contain it, so that signatures remain valid after a restart or a restore.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from datetime import datetime

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError

from app.storage.database import Database
from app.storage.models.server_secrets import ServerSecret as Row

_BYTES = 32


class ServerSecret:
    """Derives one key for each purpose. Reads the database once per process. Thread-safe."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._secret: bytes | None = None

    def ensure(self, now: datetime) -> None:
        """Create the secret unless there is one. Safe for concurrent processes."""
        if self._read() is not None:
            return
        try:
            with self._database.write() as db:
                db.add(Row(id=1, secret=secrets.token_bytes(_BYTES), created_at=now))
        except IntegrityError:
            # Another process has created it meanwhile.
            pass

    def key(self, purpose: str) -> bytes:
        """The 32-byte key for this purpose: HMAC-SHA256 of its name under the secret.

        A key reveals nothing about the secret or the keys of other purposes.
        """
        return hmac.digest(self._cached(), purpose.encode(), hashlib.sha256)

    def _cached(self) -> bytes:
        if self._secret is None:
            with self._lock:
                if self._secret is None:
                    self._secret = self._read()
        if self._secret is None:
            raise RuntimeError("expected the server's secret in the database, and it is not there")
        return self._secret

    def _read(self) -> bytes | None:
        with self._database.read() as db:
            return db.scalar(select(Row.secret))
