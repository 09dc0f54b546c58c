"""Evaluators' calls a few at a time, in the order in which they came.

A server computes one thing at a time, however many threads it has: with more of them at once each
only takes longer, and whoever holds the database while others compute holds everybody up.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial, wraps
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar

P = ParamSpec("P")
T = TypeVar("T")

#: Calls that are worked on at the same time: one computes while others wait for the database.
AT_ONCE = 4

#: Of each event loop.
_PLACES: RunVar[CapacityLimiter] = RunVar("places in line")


def in_line(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """The endpoint, in a thread as ever; whoever comes when enough are in one waits without."""

    @wraps(endpoint)
    async def waited(*args: P.args, **kwargs: P.kwargs) -> T:
        return await to_thread.run_sync(partial(endpoint, *args, **kwargs), limiter=_places())

    return waited


def _places() -> CapacityLimiter:
    try:
        return _PLACES.get()
    except LookupError:
        places = CapacityLimiter(AT_ONCE)
        _PLACES.set(places)
        return places
