"""Passwords are looked at one after the other.

Each takes 64 MiB of memory and every processor for a part of a second, and strangers may send as
many as they like. So in each process one has its turn, a few wait, and the others are told to come
back: neither evaluators nor the machine's memory have to bear it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

from .errors import TooManyPasswordsError
from .studio import Studio

#: How many wait for their turn; each keeps one of the server's 40 threads.
WAITING = 8
#: For how long they wait, in seconds.
PATIENCE_S = 5.0
#: When whoever is turned away may come back.
COME_BACK = timedelta(seconds=10)

_turn = threading.Lock()
_places = threading.BoundedSemaphore(1 + WAITING)


@contextmanager
def one_at_a_time(studio: Studio) -> Iterator[None]:
    """Within this, no other password of this process. Raises TooManyPasswordsError."""
    places, turn = _places, _turn
    if not places.acquire(blocking=False):
        raise _too_many(studio)
    try:
        if not turn.acquire(timeout=PATIENCE_S):
            raise _too_many(studio)
        try:
            yield
        finally:
            turn.release()
    finally:
        places.release()


def _too_many(studio: Studio) -> TooManyPasswordsError:
    return TooManyPasswordsError(
        f"expected at most {1 + WAITING} passwords at once: please try again in a moment",
        studio.now() + COME_BACK,
    )
