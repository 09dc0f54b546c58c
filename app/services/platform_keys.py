"""The public keys that verify Prolific's signed links, fetched and cached for a day.

They come from Prolific's published key set or from a file (`PBPO_PROLIFIC_KEYS`). An unknown key id
causes a new request at most once a minute, however many links with such ids arrive.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Iterable
from pathlib import Path

import httpx
import jwt

from app.services.runtime.errors import SignedLinkError
from app.study import signed_links
from app.study.signed_links import SignatureError

log = logging.getLogger(__name__)

_KEPT_S = 24 * 3600.0
_BETWEEN_S = 60.0
_PATIENCE_S = 5.0
#: Leeway in seconds for reading the consent page: the token is verified again with its form.
READING_S = 3600.0


class PlatformKeys:
    """The keys of one key set. place: an https URL or the path of a file. Thread-safe."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._lock = threading.Lock()
        self._keys: dict[str, jwt.PyJWK] = {}
        self._asked_at: float | None = None

    def signed(
        self, came: Iterable[tuple[str, str]], address: str, leeway_s: float = 0
    ) -> dict[str, str]:
        """Verify a signed link, and return the parameters in its token.

        came: names and values of the link's parameters. address: the URL that the token must be
        for. leeway_s: for how long an expired token is still accepted. Raises SignedLinkError.
        """
        token = next((value for name, value in came if name == signed_links.PARAMETER), "")
        try:
            key = self._key(signed_links.key_id(token))
            return signed_links.verified(token, key, address, leeway_s)
        except SignatureError as error:
            raise SignedLinkError(str(error)) from error

    def _key(self, name: str) -> jwt.PyJWK:
        with self._lock:
            age = None if self._asked_at is None else time.monotonic() - self._asked_at
            is_old = age is None or age >= _KEPT_S
            if is_old or (name not in self._keys and age is not None and age >= _BETWEEN_S):
                self._asked_at = time.monotonic()
                self._keys = self._fetched() or self._keys
            if name not in self._keys:
                raise SignatureError("expected one of Prolific's published keys, got another")
            return self._keys[name]

    def _fetched(self) -> dict[str, jwt.PyJWK]:
        try:
            if self._place.startswith("https://"):
                answer = httpx.get(self._place, timeout=_PATIENCE_S)
                found = answer.raise_for_status().json()
            else:
                found = json.loads(Path(self._place).read_text(encoding="utf-8"))
            keys = jwt.PyJWKSet.from_dict(found).keys
        except (httpx.HTTPError, OSError, ValueError, AttributeError, jwt.PyJWTError):
            log.exception("the keys by which signed links are verified could not be read")
            return {}
        return {key.key_id: key for key in keys if key.key_id is not None}
