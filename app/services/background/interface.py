"""Background work: rendering, precomputing, and jobs that take minutes.

Two implementations: `LocalBackground` does it in this server's own threads and processes,
`RemoteBackground` leaves rendering and jobs to workers. The same work asked for twice while it is
under way is done once. Nothing is kept here: what is lost is done again when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Queue:
    """What all servers together have left to workers: videos, and the workers that are there."""

    waiting: int
    running: int
    workers: int


class Background(Protocol):
    """Runs functions elsewhere, each key at most once at a time."""

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        """Run `function(*args)` in the thread that works ahead."""

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        """Run `function(*args)`, both picklable, in a process of its own.

        What is urgent, because somebody waits for it, overtakes all that is not.
        """

    def as_job(
        self,
        key: Hashable,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        """Run `function(*args)`, both picklable, in a process that may take minutes.

        Jobs come one after the other, and never in the way of a video. At the end of whoever runs
        them they are stopped: whoever keeps them begins them again. `died` is told the exit status
        of a process that ended otherwise than by returning.
        """

    def observe_queue(self, tell: Callable[[int, int], None]) -> None:
        """Call `tell` with how much waits and how much runs in processes, whenever that changes."""

    def queue(self) -> Queue | None:
        """What waits for all servers together; None where each has a queue of its own."""

    def close(self) -> None:
        """Finish what is being done here, drop what has not begun; a job is stopped."""
