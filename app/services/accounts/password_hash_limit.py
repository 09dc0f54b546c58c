"""Passwords are looked at one after the other.

Each takes 64 MiB of memory and every processor for a part of a second, and strangers may send as
many as they like. So in each process one is looked at at a time, and a bounded number waits: first
those from browsers that are known, then one from each network in turn. The others are told to come
back. Neither evaluators nor the machine's memory have to bear it, and a flood from one network
delays others by one password each.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

from app.services.context import AppContext
from app.services.runtime.errors import TooManyPasswordsError

from .login_rate_limit import ANYWHERE, CameFrom

#: How many wait for their turn, each in a thread; of one network half as many.
WAITING = 64
WAITING_OF_ONE_NETWORK = 32
#: How many from known browsers wait besides.
KNOWN_WAITING = 8
#: For how long they wait, in seconds.
PATIENCE_S = 30.0
#: When one that is turned away may come back.
COME_BACK = timedelta(seconds=10)


class _Turns:
    """Lets one at a time pass: known ones first, then one of each network in turn."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_taken = False
        self._known: deque[object] = deque()
        # In the order of their turns.
        self._networks: dict[str, deque[object]] = {}

    def acquire(self, came_from: CameFrom, patience_s: float) -> bool:
        """Wait for a turn; whether it came in time."""
        ticket = object()
        network = came_from.network
        with self._changed:
            if came_from.device is not None:
                waiting, most = self._known, KNOWN_WAITING
            else:
                waiting = self._networks.setdefault(network, deque())
                most = WAITING_OF_ONE_NETWORK
            if len(waiting) >= most:
                return False
            waiting.append(ticket)
            came = self._changed.wait_for(lambda: self._is_next(ticket), patience_s)
            waiting.remove(ticket)
            if waiting is not self._known:
                # Its network is the last again, if others of it wait.
                del self._networks[network]
                if waiting:
                    self._networks[network] = waiting
            self._is_taken = self._is_taken or came
            return came

    def release(self) -> None:
        with self._changed:
            self._is_taken = False
            self._changed.notify_all()

    def _is_next(self, ticket: object) -> bool:
        if self._is_taken:
            return False
        if self._known:
            return self._known[0] is ticket
        return next(iter(self._networks.values()))[0] is ticket

    def __enter__(self) -> None:
        self.acquire(ANYWHERE, PATIENCE_S)

    def __exit__(self, *_: object) -> None:
        self.release()


_turn = _Turns()
_places = threading.BoundedSemaphore(1 + WAITING)
_known_places = threading.BoundedSemaphore(1 + KNOWN_WAITING)


@contextmanager
def one_at_a_time(app: AppContext, came_from: CameFrom = ANYWHERE) -> Iterator[None]:
    """Within this, no other password of this process. Raises TooManyPasswordsError."""
    places, turn = _places if came_from.device is None else _known_places, _turn
    if not places.acquire(blocking=False):
        raise _too_many(app)
    try:
        if not turn.acquire(came_from, PATIENCE_S):
            raise _too_many(app)
        try:
            yield
        finally:
            turn.release()
    finally:
        places.release()


def _too_many(app: AppContext) -> TooManyPasswordsError:
    return TooManyPasswordsError(
        "expected fewer passwords at once: please try again in a moment",
        app.now() + COME_BACK,
    )
