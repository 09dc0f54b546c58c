"""Long polling for work: requests wait for rollouts without a thread and without a connection.

One task per process looks at the database once a second for all waiting requests, and at once when
this process has asked for a rollout. It wakes as many requests as there are rollouts for them; each
then claims its own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool

from app.services.rollouts import work_signal

#: Longest time between two looks at the database, in seconds.
LOOK_EVERY_S: Final = 1.0

#: Finds the numbers of rollouts that can be claimed in these studies, by study and environment.
Find = Callable[[Collection[int]], Mapping[tuple[int, str], int]]


@dataclass(eq=False)
class Waiter:
    """One waiting request. environments: which rollouts it takes; None for all of its study."""

    study_id: int
    environments: frozenset[str] | None
    _woken: asyncio.Event = field(default_factory=asyncio.Event)

    def wake(self) -> None:
        """End the present wait."""
        self._woken.set()

    async def wait(self, seconds: float) -> bool:
        """Wait until woken; returns False if that did not happen within `seconds`."""
        try:
            async with asyncio.timeout(seconds):
                await self._woken.wait()
        except TimeoutError:
            return False
        self._woken.clear()
        return True

    def takes(self, environment: str) -> bool:
        """Whether it takes rollouts of this environment and has not been woken yet."""
        is_wanted = self.environments is None or environment in self.environments
        return is_wanted and not self._woken.is_set()


class WorkPolling:
    """The waiting requests of one process, and the task that wakes them. For one event loop."""

    def __init__(self) -> None:
        self._waiters: dict[Waiter, None] = {}
        self._task: asyncio.Task[None] | None = None

    def number(self, study_id: int) -> int:
        """How many requests wait for rollouts of a study."""
        return sum(waiter.study_id == study_id for waiter in self._waiters)

    @contextmanager
    def waiting(
        self,
        study_id: int,
        environments: Collection[str] | None,
        find: Find,
        stopping: Callable[[], bool],
    ) -> Iterator[Waiter]:
        """A waiter that is woken from now on, so that nothing asked for meanwhile is missed.

        stopping: whether the server is about to stop, which wakes every waiter.
        """
        waiter = Waiter(study_id, None if environments is None else frozenset(environments))
        self._waiters[waiter] = None
        if self._task is None:
            self._task = asyncio.create_task(self._look(find, stopping))
        try:
            yield waiter
        finally:
            del self._waiters[waiter]
            if not self._waiters and self._task is not None:
                self._task.cancel()
                self._task = None

    async def _look(self, find: Find, stopping: Callable[[], bool]) -> None:
        loop, asked = asyncio.get_running_loop(), asyncio.Event()
        with work_signal.listening(lambda: _wake(loop, asked)):
            while self._waiters:
                try:
                    async with asyncio.timeout(LOOK_EVERY_S):
                        await asked.wait()
                except TimeoutError:
                    pass
                asked.clear()
                if stopping():
                    for waiter in self._waiters:
                        waiter.wake()
                elif self._waiters:
                    await self._wake_those_with_work(find)

    async def _wake_those_with_work(self, find: Find) -> None:
        studies = {waiter.study_id for waiter in self._waiters}
        try:
            found = await run_in_threadpool(find, studies)
        except SQLAlchemyError:
            # Each waiter looks for itself when its time is over, and reports the error.
            return
        for (study_id, environment), number in found.items():
            waiters = (
                waiter
                for waiter in self._waiters
                if waiter.study_id == study_id and waiter.takes(environment)
            )
            for waiter, _ in zip(waiters, range(number), strict=False):
                waiter.wake()


def _wake(loop: asyncio.AbstractEventLoop, asked: asyncio.Event) -> None:
    try:
        loop.call_soon_threadsafe(asked.set)
    except RuntimeError:
        # The loop has been closed: nobody waits there any more.
        return
