"""Limits password hashing to one at a time per process, with a bounded fair queue.

One hash takes 64 MiB of memory and every processor for a fraction of a second, and strangers can
send any number of passwords. Attempts from known browsers go first, then those of one network after
the other in rotation. Attempts beyond the bounds are refused with 429. This protects evaluators'
response times and the machine's memory, and a flood from one network delays others by one hash
each.
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

#: How many attempts may wait, each in a thread: in total, and from one network.
MAX_WAITING = 64
MAX_WAITING_PER_NETWORK = 32
#: How many attempts from known browsers may wait in addition.
MAX_WAITING_KNOWN = 8
#: The longest wait, in seconds.
WAIT_TIMEOUT_S = 30.0
#: The delay that a refused client is asked to keep before it tries again.
RETRY_AFTER = timedelta(seconds=10)


class _FairQueue:
    """A mutex with a queue: known browsers first, then the networks in rotation."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_busy = False
        self._known: deque[object] = deque()
        # In order of rotation.
        self._networks: dict[str, deque[object]] = {}

    def acquire(self, came_from: CameFrom, timeout_s: float) -> bool:
        """Wait until the mutex is free; False after `timeout_s` seconds or if the queue is full."""
        ticket = object()
        network = came_from.network
        with self._changed:
            if came_from.device is not None:
                waiting, most = self._known, MAX_WAITING_KNOWN
            else:
                waiting = self._networks.setdefault(network, deque())
                most = MAX_WAITING_PER_NETWORK
            if len(waiting) >= most:
                return False
            waiting.append(ticket)
            came = self._changed.wait_for(lambda: self._is_next(ticket), timeout_s)
            waiting.remove(ticket)
            if waiting is not self._known:
                # The network moves to the end of the rotation if more of its attempts wait.
                del self._networks[network]
                if waiting:
                    self._networks[network] = waiting
            self._is_busy = self._is_busy or came
            return came

    def release(self) -> None:
        """Release the mutex to the next in the queue."""
        with self._changed:
            self._is_busy = False
            self._changed.notify_all()

    def _is_next(self, ticket: object) -> bool:
        if self._is_busy:
            return False
        if self._known:
            return self._known[0] is ticket
        return next(iter(self._networks.values()))[0] is ticket

    def __enter__(self) -> None:
        self.acquire(ANYWHERE, WAIT_TIMEOUT_S)

    def __exit__(self, *_: object) -> None:
        self.release()


_queue = _FairQueue()
_slots = threading.BoundedSemaphore(1 + MAX_WAITING)
_known_slots = threading.BoundedSemaphore(1 + MAX_WAITING_KNOWN)


@contextmanager
def hash_slot(app: AppContext, came_from: CameFrom = ANYWHERE) -> Iterator[None]:
    """Context in which the caller alone may hash a password. Raises TooManyPasswordsError."""
    slots, queue = _slots if came_from.device is None else _known_slots, _queue
    if not slots.acquire(blocking=False):
        raise _too_many(app)
    try:
        if not queue.acquire(came_from, WAIT_TIMEOUT_S):
            raise _too_many(app)
        try:
            yield
        finally:
            queue.release()
    finally:
        slots.release()


def _too_many(app: AppContext) -> TooManyPasswordsError:
    return TooManyPasswordsError(
        "expected fewer passwords at once: please try again in a moment",
        app.now() + RETRY_AFTER,
    )
