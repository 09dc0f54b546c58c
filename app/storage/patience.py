"""Who does not wait: a caller that holds everybody else up for as long as it takes.

A server's event loop is one. What it asks for is done if it can be done at once, and else not even
begun: it is then asked for again by a thread, which may take its time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_AT_ONCE: ContextVar[bool] = ContextVar("at once", default=False)


class NeedsPatienceError(Exception):
    """It could not be done at once; nothing of it was done."""


class BusyError(NeedsPatienceError):
    """Somebody else writes: in some milliseconds it can be done at once, most likely."""


@contextmanager
def at_once() -> Iterator[None]:
    """Within this, whatever would have to wait raises NeedsPatienceError."""
    before = _AT_ONCE.set(True)
    try:
        yield
    finally:
        _AT_ONCE.reset(before)


def is_lacking() -> bool:
    """Whether the caller does not wait."""
    return _AT_ONCE.get()


def require() -> None:
    """Before what takes its time. Raises NeedsPatienceError."""
    if is_lacking():
        raise NeedsPatienceError
