"""Wakes what waits for rollouts within this process when a transaction has asked for one.

It only shortens the wait: whatever waits also looks at the database once a second, since another
process may have asked.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sqlalchemy import event
from sqlalchemy.orm import Session

_lock = threading.Lock()
_listeners: set[Callable[[], None]] = set()


@contextmanager
def listening(wake: Callable[[], None]) -> Iterator[None]:
    """Call `wake` after each commit that asked for a rollout, in that transaction's thread.

    wake: returns at once and raises nothing.
    """
    with _lock:
        _listeners.add(wake)
    try:
        yield
    finally:
        with _lock:
            _listeners.discard(wake)


def notify_after_commit(db: Session) -> None:
    """Wake the listeners once the transaction of `db` has committed."""
    if not event.contains(db, "after_commit", _notify):
        event.listen(db, "after_commit", _notify)


def _notify(_db: Session) -> None:
    with _lock:
        listeners = list(_listeners)
    for wake in listeners:
        wake()
