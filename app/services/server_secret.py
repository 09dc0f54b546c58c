"""Keys for the server's own use, derived from one random secret in the database.

The secret is made when the first process opens the database. All processes read the same one, and
a backup carries it, so that what was signed before a restart or a restore is still recognised.
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
    """Derives one key for each purpose. The database is read once per process."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._secret: bytes | None = None

    def ensure(self, now: datetime) -> None:
        """Make the secret unless the database has one. Several processes may do so at once."""
        if self._read() is not None:
            return
        try:
            with self._database.write() as db:
                db.add(Row(id=1, secret=secrets.token_bytes(_BYTES), created_at=now))
        except IntegrityError:
            # Another process has made it in the meantime: that one holds.
            pass

    def key(self, purpose: str) -> bytes:
        """32 bytes, always the same for this purpose: HMAC-SHA256 of its name by the secret.

        Nothing about the secret, or about the key of another purpose, follows from a key.
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
