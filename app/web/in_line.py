"""Evaluators' calls: at once where they can be, else a few at a time, in the order they came in.

A server computes one thing at a time, however many threads it has: with more of them at once each
only takes longer, and whoever holds the database while others compute holds everybody up. Each
statement to SQLite even lets another thread go first, and then waits for it. So what is asked most,
and takes a few milliseconds, is done by the server's event loop itself, as long as it has to wait
for nobody. In line, who writes may have to wait for the database; who only looks never does, and so
has a place kept free.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

from anyio import CapacityLimiter, fail_after, sleep, to_thread
from anyio.lowlevel import RunVar
from sqlalchemy.exc import TimeoutError as WaitedTooLongError

from app.services.studio import Studio
from app.storage import patience

P = ParamSpec("P")
T = TypeVar("T")

#: Calls that are worked on at the same time: one computes while others wait for the database.
PLACES = 3
#: Of these, calls that may write.
WRITING = PLACES - 1
#: After which a call that was to be done at once is tried again, in seconds, while somebody else
#: writes: most hold the database for a few milliseconds. Then it stands in line.
PAUSES_S = (0.002, 0.004, 0.008, 0.016)
#: For how long a call that may write waits for its place, in seconds: pages give up then, too, and
#: send it again.
PATIENCE_S = 15.0


@dataclass(frozen=True)
class _Places:
    """Those of all, and those of writers among them."""

    of_all: CapacityLimiter
    of_writers: CapacityLimiter


#: Of each event loop.
_PLACES: RunVar[_Places] = RunVar("places in line")


def in_line(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """The endpoint, which may write, in a thread as ever; who waits for a place waits without.

    Raises SQLAlchemy's TimeoutError, having done nothing, where no place was free for too long.
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


def in_line_to_look(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """The endpoint, which writes nothing, as `in_line`: it waits for nobody who waits to write."""

    @wraps(endpoint)
    async def waited(*args: P.args, **kwargs: P.kwargs) -> T:
        return await to_thread.run_sync(
            partial(endpoint, *args, **kwargs), limiter=_places().of_all
        )

    return waited


def at_once(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """The endpoint, which may write, done before anything else; `in_line` if it has to wait."""
    return _at_once(endpoint, in_line(endpoint))


def at_once_to_look(endpoint: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """The same for one that writes nothing."""
    return _at_once(endpoint, in_line_to_look(endpoint))


def _at_once(
    endpoint: Callable[P, T], later: Callable[P, Awaitable[T]]
) -> Callable[P, Awaitable[T]]:
    @wraps(endpoint)
    async def done(*args: P.args, **kwargs: P.kwargs) -> T:
        if _studio(kwargs).database.answers_at_once:
            # Of what cannot be done at once nothing was done: it is begun anew.
            with suppress(patience.NeedsPatienceError):
                for pause_s in PAUSES_S:
                    with suppress(patience.BusyError), patience.at_once():
                        return endpoint(*args, **kwargs)
                    await sleep(pause_s)
        return await later(*args, **kwargs)

    return done


def _studio(arguments: Mapping[str, Any]) -> Studio:
    studio: Studio = arguments["studio"]
    return studio


def _places() -> _Places:
    try:
        return _PLACES.get()
    except LookupError:
        places = _Places(CapacityLimiter(PLACES), CapacityLimiter(WRITING))
        _PLACES.set(places)
        return places
