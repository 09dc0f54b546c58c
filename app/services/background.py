"""The one door to work that is not done while somebody waits: rendering, and working ahead.

Rendering runs in processes of its own, working ahead in one thread. The same work asked for twice
while it is under way is done once. Nothing here needs to survive: what is lost is done again when
it is asked for.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

log = logging.getLogger(__name__)

T = TypeVar("T")


def _end_with_parent() -> None:
    """Make a worker leave when its server is killed: a pool's workers would wait for ever."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
    # Ctrl+C reaches the whole group of processes: it is the server's to answer.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A video for later must never take the processor from a page that is asked for now.
    os.nice(10)


class Background:
    """Runs functions elsewhere, each key at most once at a time."""

    def __init__(self, processes: int) -> None:
        self._ahead = ThreadPoolExecutor(1, thread_name_prefix="work-ahead")
        self._processes = _Processes(processes)
        self._jobs = _Jobs()
        self._lock = threading.Lock()
        self._under_way: dict[Hashable, Future[Any]] = {}

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        """Run `function(*args)` in the thread that works ahead."""
        with self._lock:
            if (future := self._under_way.get(key)) is not None:
                return future
            future = self._under_way[key] = self._ahead.submit(function, *args)
        future.add_done_callback(partial(self._done, key))
        return future

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        """Run `function(*args)`, both picklable, in a process of its own.

        What is urgent, because somebody waits for it, overtakes all that is not.
        """
        return self._processes.submit(key, partial(function, *args), urgent=urgent)

    def as_job(
        self,
        key: Hashable,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        """Run `function(*args)`, both picklable, in a process that may take minutes.

        Jobs come one after the other, and never in the way of a video. At the end of the server
        they are stopped: whoever keeps them begins them again. `died` is told the exit status of
        a process that ended otherwise than by returning.
        """
        self._jobs.submit(key, function, args, died)

    def tell_queue(self, tell: Callable[[int, int], None]) -> None:
        """Call `tell` with how much waits and how much runs in processes, whenever that changes."""
        self._processes.tell = tell

    def close(self) -> None:
        """Finish what is being done, drop what has not begun; a job is stopped."""
        self._jobs.close()
        self._ahead.shutdown(wait=True, cancel_futures=True)
        self._processes.close()

    def _done(self, key: Hashable, finished: Future[Any]) -> None:
        with self._lock:
            self._under_way.pop(key, None)
        _log_fault(key, finished)


class _Jobs:
    """One process at a time, each of its own: it can be stopped, which a pool's cannot."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="jobs")
        self._lock = threading.Lock()
        self._keys: set[Hashable] = set()
        self._process: SpawnProcess | None = None
        self._closed = False

    def submit(
        self,
        key: Hashable,
        function: Callable[..., None],
        args: tuple[Any, ...],
        died: Callable[[int], None],
    ) -> None:
        with self._lock:
            if self._closed or key in self._keys:
                return
            self._keys.add(key)
        self._thread.submit(self._run, key, function, args, died).add_done_callback(
            partial(_log_fault, key)
        )

    def close(self) -> None:
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.terminate()
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _run(
        self,
        key: Hashable,
        function: Callable[..., None],
        args: tuple[Any, ...],
        died: Callable[[int], None],
    ) -> None:
        process = multiprocessing.get_context("spawn").Process(
            target=_as_worker, args=(function, args), daemon=True
        )
        try:
            with self._lock:
                if self._closed:
                    return
                process.start()
                self._process = process
            process.join()
            with self._lock:
                self._process = None
                was_stopped = self._closed
            if process.exitcode and not was_stopped:
                died(process.exitcode)
        finally:
            with self._lock:
                self._keys.discard(key)


def _as_worker(function: Callable[..., None], args: tuple[Any, ...]) -> None:
    _end_with_parent()
    function(*args)


class _Processes:
    """A pool of processes with a queue that the urgent may jump: the pool's own has no order."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._lock = threading.Lock()
        self._waiting: OrderedDict[Hashable, tuple[Callable[[], Any], Future[Any]]] = OrderedDict()
        self._running: dict[Hashable, Future[Any]] = {}
        self._pool: ProcessPoolExecutor | None = None
        self._closed = False
        self.tell: Callable[[int, int], None] = lambda _waiting, _running: None

    def submit(self, key: Hashable, work: Callable[[], T], *, urgent: bool) -> Future[T]:
        with self._lock:
            if (running := self._running.get(key)) is not None:
                return running
            _, future = self._waiting.setdefault(key, (work, Future()))
            if urgent:
                self._waiting.move_to_end(key, last=False)
        self._start_waiting()
        return future

    def close(self) -> None:
        with self._lock:
            self._closed = True
            dropped = list(self._waiting.values())
            self._waiting.clear()
            pool, self._pool = self._pool, None
        for _, future in dropped:
            future.cancel()
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)

    def _start_waiting(self) -> None:
        while True:
            with self._lock:
                if self._closed or not self._waiting or len(self._running) >= self._number:
                    self.tell(len(self._waiting), len(self._running))
                    return
                key, (work, future) = self._waiting.popitem(last=False)
                if not future.set_running_or_notify_cancel():
                    continue
                self._running[key] = future
                try:
                    inner = self._open_pool().submit(work)
                except BrokenProcessPool:
                    # A worker was killed, for want of memory say: the next ones start afresh.
                    self._pool = None
                    inner = self._open_pool().submit(work)
            inner.add_done_callback(partial(self._done, key, future))

    def _open_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._number,
                # A fork would copy the server's locks in whatever state they are.
                mp_context=multiprocessing.get_context("spawn"),
                initializer=_end_with_parent,
            )
        return self._pool

    def _done(self, key: Hashable, future: Future[Any], inner: Future[Any]) -> None:
        with self._lock:
            self._running.pop(key, None)
        if inner.cancelled():
            future.set_exception(CancelledError())
        elif (error := inner.exception()) is not None:
            future.set_exception(error)
        else:
            future.set_result(inner.result())
        _log_fault(key, inner)
        self._start_waiting()


def _log_fault(key: Hashable, finished: Future[Any]) -> None:
    if not finished.cancelled() and (error := finished.exception()) is not None:
        log.error("background work %r failed", key, exc_info=error)
