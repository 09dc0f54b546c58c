"""A bounded set of hashes of secrets, for what is true of them forever."""

from __future__ import annotations

from threading import Lock

from cachetools import LRUCache

#: Hashes that are kept: 64 characters each, so a few megabytes.
_MAX_HASHES = 20_000


class KnownHashes:
    """The hashes that were added or asked for last. Thread-safe."""

    def __init__(self) -> None:
        self._hashes: LRUCache[str, bool] = LRUCache(_MAX_HASHES)
        self._lock = Lock()

    def __contains__(self, hashed: str) -> bool:
        with self._lock:
            return self._hashes.get(hashed, False)

    def add(self, hashed: str) -> None:
        """Add a hash; if there are too many, the one that was used longest ago is dropped."""
        with self._lock:
            self._hashes[hashed] = True
