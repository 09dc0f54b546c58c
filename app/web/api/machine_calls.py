"""Calls of machines: the caller, how many calls it may send, and the threads that run them."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from typing import Annotated, Final, ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar
from cachetools import LRUCache
from fastapi import Depends, Header, Request

from app.services.rollouts import machines
from app.services.rollouts.machines import MachineCaller
from app.services.runtime.errors import TooManyError
from app.web.http.security import app_context_of, bearer

#: Calls of one machine to one process: at once, and per second after that. A machine sends a few
#: per rollout; one that sends more is in a loop.
BURST: Final = 100
PER_SECOND: Final = 20.0
#: Machines whose calls are counted.
_MOST_COUNTED: Final = 10_000


P = ParamSpec("P")
T = TypeVar("T")

#: Calls of machines that run at the same time, in threads of their own: evaluators do not queue
#: behind them.
_THREADS: Final = 4
_threads: RunVar[CapacityLimiter] = RunVar("threads of machines' calls")


async def in_machine_thread(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Run the function in one of a few threads that machines' calls share; waiting holds none."""
    try:
        limiter = _threads.get()
    except LookupError:
        limiter = CapacityLimiter(_THREADS)
        _threads.set(limiter)
    return await to_thread.run_sync(partial(function, *args, **kwargs), limiter=limiter)


class CallLimit:
    """Token buckets by machine, in the memory of one process."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        #: Calls left, and when that was counted.
        self._left: LRUCache[int, tuple[float, float]] = LRUCache(_MOST_COUNTED)

    def seconds_to_wait(self, machine_id: int) -> float:
        """Count a call. Returns 0 if it is allowed, else the seconds until one will be."""
        now = self._clock()
        left, counted = self._left.get(machine_id, (float(BURST), now))
        left = min(BURST, left + PER_SECOND * (now - counted))
        allowed = left >= 1
        self._left[machine_id] = (left - 1 if allowed else left, now)
        return 0.0 if allowed else (1 - left) / PER_SECOND


async def machine(
    slug: str,
    request: Request,
    authorization: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> MachineCaller:
    """The machine whose token came. Raises SignInRequiredError or TooManyError."""
    app = app_context_of(request)
    caller = await in_machine_thread(machines.authenticate, app, slug, bearer(authorization))
    limit: CallLimit = request.app.state.machine_calls
    wait_s = limit.seconds_to_wait(caller.machine_id)
    if wait_s > 0:
        raise TooManyError(
            f"expected at most {PER_SECOND:g} calls per second of a machine",
            app.now() + timedelta(seconds=wait_s),
        )
    return caller


MachineDep = Annotated[MachineCaller, Depends(machine)]
