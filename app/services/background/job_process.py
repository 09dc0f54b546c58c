"""Runner of jobs: one child process per job, which can be terminated."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from multiprocessing.process import BaseProcess
from typing import Any

from app.services.runtime.child_process import child_context, log_failure, set_up_child_process


class JobProcesses:
    """Runs jobs one at a time, each in a new process, which unlike a pool's can be terminated."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="jobs")
        self._lock = threading.Lock()
        self._under_way: dict[Hashable, Future[bool]] = {}
        self._process: BaseProcess | None = None
        self._closed = False

    def submit(
        self,
        key: Hashable,
        function: Callable[..., None],
        args: tuple[Any, ...],
        died: Callable[[int], None],
    ) -> Future[bool]:
        """Queue `function(*args)`. The future's result is False if the job was terminated.

        A key that is queued or running already is not queued again. died: called with the exit
        status if the process fails.
        """
        with self._lock:
            if (under_way := self._under_way.get(key)) is not None:
                return under_way
            if self._closed:
                stopped: Future[bool] = Future()
                stopped.set_result(False)
                return stopped
            future = self._under_way[key] = self._thread.submit(
                self._run, key, function, args, died
            )
        future.add_done_callback(partial(log_failure, key))
        return future

    def close(self) -> None:
        """Terminate the running job, and drop the queued ones."""
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
    ) -> bool:
        process = child_context().Process(target=_as_worker, args=(function, args), daemon=True)
        try:
            with self._lock:
                if self._closed:
                    return False
                process.start()
                self._process = process
            process.join()
            with self._lock:
                self._process = None
                was_stopped = self._closed
            if process.exitcode and not was_stopped:
                died(process.exitcode)
            return not (process.exitcode and was_stopped)
        finally:
            with self._lock:
                self._under_way.pop(key, None)


def _as_worker(function: Callable[..., None], args: tuple[Any, ...]) -> None:
    set_up_child_process()
    function(*args)
