"""Background work: rendering, precomputing, and jobs that take minutes.

Two implementations: `LocalBackground` uses threads and child processes of this server,
`RemoteBackground` enqueues rendering and jobs for workers. A key that is submitted again while it
is waiting or running is executed once. Nothing is persistent here; callers submit lost work again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Queue:
    """The render queue shared by all servers: waiting and running videos, and active workers."""

    waiting: int
    running: int
    workers: int


class Background(Protocol):
    """Runs functions in the background, each key at most once at a time."""

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        """Run `function(*args)` in the single background thread, used for precomputing."""

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        """Run `function(*args)`, both picklable, in a child process.

        urgent: put it at the head of the queue, because a person is waiting for it.
        """

    def as_job(
        self,
        key: Hashable,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        """Run `function(*args)`, both picklable, as a job that may take minutes.

        Jobs run one at a time, apart from the queue of `in_process`. A running job is terminated
        when its runner stops, and the `jobs` service restarts it. died: called with the exit status
        if the process ends other than by returning.
        """

    def observe_queue(self, tell: Callable[[int, int], None]) -> None:
        """Call `tell(waiting, running)` whenever the queue of `in_process` changes."""

    def queue(self) -> Queue | None:
        """The queue shared by all servers; None if each server has its own."""

    def close(self) -> None:
        """Finish running work, drop waiting work, and terminate a running job."""
