"""What was learnt of a store, remembered for a while."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")

#: Things remembered at the most: twice as many as a large studio has recordings.
MOST = 20_000


class Memory(Generic[K, V]):
    """Values that are forgotten after their time, and the oldest first where there are many."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: OrderedDict[K, tuple[V, float]] = OrderedDict()

    def keep(self, key: K, value: V, seconds: float) -> None:
        with self._lock:
            self._held.pop(key, None)
            self._held[key] = value, time.monotonic() + seconds
            while len(self._held) > MOST:
                self._held.popitem(last=False)

    def find(self, key: K) -> tuple[V, float] | None:
        """The value, and for how many more seconds it is remembered; None if it is forgotten."""
        with self._lock:
            held = self._held.get(key)
        if held is None:
            return None
        left = held[1] - time.monotonic()
        return (held[0], left) if left > 0 else None

    def clear(self) -> None:
        with self._lock:
            self._held.clear()

    def forget(self, key: K) -> None:
        with self._lock:
            self._held.pop(key, None)
