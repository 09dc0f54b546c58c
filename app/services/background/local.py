"""Background work within one server: a thread, a pool of processes, and a runner of jobs."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, TypeVar

from app.services.runtime.child_process import child_context, log_failure, set_up_child_process

from .interface import Background
from .job_process import JobProcesses

T = TypeVar("T")


class LocalBackground(Background):
    """One thread for precomputing, `processes` processes for rendering, and one for jobs."""

    def __init__(self, processes: int) -> None:
        self._ahead = ThreadPoolExecutor(1, thread_name_prefix="work-ahead")
        self._processes = _Processes(processes)
        self._jobs = JobProcesses()
        self._lock = threading.Lock()
        self._under_way: dict[Hashable, Future[Any]] = {}

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        with self._lock:
            if (future := self._under_way.get(key)) is not None:
                return future
            future = self._under_way[key] = self._ahead.submit(function, *args)
        future.add_done_callback(partial(self._done, key))
        return future

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        return self._processes.submit(key, partial(function, *args), urgent=urgent)

    def as_job(
        self,
        key: Hashable,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        self._jobs.submit(key, function, args, died)

    def observe_queue(self, tell: Callable[[int, int], None]) -> None:
        self._processes.tell = tell

    def queue(self) -> None:
        return None

    def close(self) -> None:
        self._jobs.close()
        self._ahead.shutdown(wait=True, cancel_futures=True)
        self._processes.close()

    def _done(self, key: Hashable, finished: Future[Any]) -> None:
        with self._lock:
            self._under_way.pop(key, None)
        log_failure(key, finished)


class _Processes:
    """A process pool with a priority queue, which ProcessPoolExecutor does not have."""

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
                    # A worker was killed, for example by the OOM killer: start a new pool.
                    self._pool = None
                    inner = self._open_pool().submit(work)
            inner.add_done_callback(partial(self._done, key, future))

    def _open_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._number,
                mp_context=child_context(),
                initializer=set_up_child_process,
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
        log_failure(key, inner)
        self._start_waiting()
