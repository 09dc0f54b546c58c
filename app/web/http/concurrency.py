"""Concurrency limit for evaluators' calls: a few at a time in worker threads, the others queue.

A Python process computes one thing at a time, so more threads only make each call take longer, and
a thread that holds the database while others compute delays every writer. Calls that may write
share all places but one; that one is kept for calls that only read, which never wait for a writer.
Waiting for a place holds no thread.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial, wraps
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter, fail_after, to_thread
from anyio.lowlevel import RunVar
from sqlalchemy.exc import TimeoutError as WaitedTooLongError

P = ParamSpec("P")
T = TypeVar("T")

#: Calls that run at the same time: one computes while others wait for the database.
PLACES = 3
#: Of these, calls that may write.
WRITING = PLACES - 1
#: Longest wait of a call that may write for its place, in seconds. Pages time out then as well and
#: send the call again.
PATIENCE_S = 15.0


@dataclass(frozen=True)
class _Places:
    """The limiter of all calls, and the limiter of those that may write."""

    of_all: CapacityLimiter
    of_writers: CapacityLimiter


_PLACES: RunVar[_Places] = RunVar("concurrency limiters")


def limited_write(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """Run the endpoint, which may write, in a worker thread, at most `WRITING` at a time.

    Waiting for a place holds no thread. Raises SQLAlchemy's TimeoutError, before the endpoint has
    run, if no place becomes free within `PATIENCE_S`.
    """

    @wraps(endpoint)
    async def waited(*args: P.args, **kwargs: P.kwargs) -> T:
        places = _places()
        try:
            with fail_after(PATIENCE_S):
                await places.of_writers.acquire()
        except TimeoutError:
            raise WaitedTooLongError("others who write were waited for too long") from None
        try:
            return await to_thread.run_sync(
                partial(endpoint, *args, **kwargs), limiter=places.of_all
            )
        finally:
            places.of_writers.release()

    return waited


def limited_read(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """Run the endpoint, which only reads, in a worker thread; it never waits for queued writers."""

    @wraps(endpoint)
    async def waited(*args: P.args, **kwargs: P.kwargs) -> T:
        return await to_thread.run_sync(
            partial(endpoint, *args, **kwargs), limiter=_places().of_all
        )

    return waited


def _places() -> _Places:
    try:
        return _PLACES.get()
    except LookupError:
        places = _Places(CapacityLimiter(PLACES), CapacityLimiter(WRITING))
        _PLACES.set(places)
        return places
