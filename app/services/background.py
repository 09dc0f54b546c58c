"""The one door to work that is not done while somebody waits: rendering, and working ahead.

Rendering runs in processes of its own, working ahead in one thread. The same work asked for twice
while it is under way is done once. Nothing here needs to survive: what is lost is done again when
it is asked for.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

T = TypeVar("T")

log = logging.getLogger(__name__)


def _end_with_parent() -> None:
    """Make a worker leave when its server is killed: a pool's workers would wait for ever."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
    # A video for later must never take the processor from a page that is asked for now.
    os.nice(10)


class Background:
    """Runs functions elsewhere, each key at most once at a time."""

    def __init__(self, render_jobs: int) -> None:
        self._render_jobs = render_jobs
        self._lock = threading.Lock()
        self._under_way: dict[Hashable, Future[Any]] = {}
        self._threads = ThreadPoolExecutor(1, thread_name_prefix="work-ahead")
        self._processes: ProcessPoolExecutor | None = None
        self._closed = False

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        """Run `function(*args)` in the thread that works ahead."""
        return self._once(key, self._threads, function, *args)

    def in_process(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        """Run `function(*args)`, both picklable, in a process of its own."""
        try:
            return self._once(key, self._pool(), function, *args)
        except BrokenProcessPool:
            # A worker was killed (out of memory, say). The next one starts afresh.
            with self._lock:
                self._processes = None
            return self._once(key, self._pool(), function, *args)

    def close(self) -> None:
        """Finish what is being done, drop what has not begun."""
        self._closed = True
        self._threads.shutdown(wait=True, cancel_futures=True)
        if self._processes is not None:
            self._processes.shutdown(wait=True, cancel_futures=True)

    def _pool(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._processes is None:
                self._processes = ProcessPoolExecutor(
                    self._render_jobs,
                    # A fork would copy the server's locks in whatever state they are.
                    mp_context=multiprocessing.get_context("spawn"),
                    initializer=_end_with_parent,
                )
            return self._processes

    def _once(
        self, key: Hashable, executor: Executor, function: Callable[..., T], *args: Any
    ) -> Future[T]:
        with self._lock:
            future = self._under_way.get(key)
            if future is not None:
                return future
            future = executor.submit(function, *args)
            self._under_way[key] = future

        def done(finished: Future[T]) -> None:
            with self._lock:
                self._under_way.pop(key, None)
            if not finished.cancelled() and (error := finished.exception()) is not None:
                log.error("background work %r failed", key, exc_info=error)

        future.add_done_callback(done)
        return future
