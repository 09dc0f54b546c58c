"""Background work by workers: enqueues tasks and polls their state, in one thread.

Precomputing stays in the server, because its results are cached in memory.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import CancelledError, Future
from typing import Any, TypeVar

from app.services.runtime.errors import StoreAwayError
from app.storage.procrastinate_tables import RUNNING, WAITING
from app.storage.task_queue import JOB, RENDER, State, Task, TaskQueue

from .interface import Background, Queue
from .local import LocalBackground

log = logging.getLogger(__name__)

T = TypeVar("T")

#: Priorities of a rendering that a person is waiting for, and of one that will be needed later.
URGENT, LATER = 10, 0

#: Interval of polling in seconds, short enough not to be noticed.
_POLL_S = 0.1


class WorkerFailedError(Exception):
    """A worker failed at the task. The message is that of its error."""


class RemoteBackground(Background):
    """Leaves rendering and jobs to workers by the task queue.

    `in_process` accepts only renderings, with the key ("render", locator), and ignores the
    function. Its futures have the result None; the video is in the store.
    """

    def __init__(self, queue: TaskQueue) -> None:
        self._queue = queue
        self._local = LocalBackground(1)
        self._changed = threading.Condition()
        self._asked: list[Task] = []
        #: Futures of waiting callers by the task's key; keys of the polled tasks by id.
        self._waiting: dict[str, Future[Any]] = {}
        self._followed: dict[int, str] = {}
        self._thread: threading.Thread | None = None
        self._closed = False

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        return self._local.in_thread(key, function, *args)

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        match key:
            case (str(name), str(argument)) if name == RENDER:
                task = Task(name, argument, URGENT if urgent else LATER)
            case _:
                raise TypeError(
                    f"expected a video to be rendered, which workers can do, got {key!r}"
                )
        with self._changed:
            future = self._waiting.get(task.key)
            if future is None:
                future = self._waiting[task.key] = Future()
                # It cannot be cancelled, because several callers may share it.
                future.set_running_or_notify_cancel()
            elif not urgent:
                return future
            self._submit(task)
        return future

    def as_job(
        self,
        key: Hashable,
        function: Callable[..., None],
        *args: Any,
        died: Callable[[int], None],
    ) -> None:
        with self._changed:
            self._submit(Task(JOB, str(key)))

    def observe_queue(self, tell: Callable[[int, int], None]) -> None:
        """A no-op: each server would report the shared queue as its own."""

    def queue(self) -> Queue:
        waiting, running = self._queue.count(RENDER)
        return Queue(waiting, running, self._queue.workers())

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()
        for key in list(self._waiting):
            self._end(key, CancelledError())
        self._local.close()

    def _submit(self, task: Task) -> None:
        self._asked.append(task)
        if self._thread is None:
            self._thread = threading.Thread(target=self._follow, name="workers-asked", daemon=True)
            self._thread.start()
        self._changed.notify()

    def _follow(self) -> None:
        while True:
            with self._changed:
                if not self._asked:
                    self._changed.wait(_POLL_S if self._followed else None)
                if self._closed and not self._asked:
                    return
                asked, self._asked = self._asked, []
            for task in asked:
                self._enqueue(task)
            self._poll()

    def _enqueue(self, task: Task) -> None:
        try:
            task_id = self._queue.enqueue(task)
        except Exception as error:
            log.exception("workers could not be asked for %s", task.key)
            self._end(task.key, error)
        else:
            if task.name == RENDER:
                self._followed[task_id] = task.key

    def _poll(self) -> None:
        if not self._followed:
            return
        try:
            states = self._queue.states(list(self._followed))
        except Exception as error:
            # The waiting callers get the error and may retry; the tasks stay in the queue.
            log.exception("how far workers are could not be looked up")
            for task_id in list(self._followed):
                self._end(self._followed.pop(task_id), error)
            return
        for task_id in list(self._followed):
            state = states.get(task_id)
            if state is None or state.status not in (WAITING, RUNNING):
                self._end(self._followed.pop(task_id), _parse_error(state))

    def _end(self, key: str, error: Exception | None) -> None:
        with self._changed:
            future = self._waiting.pop(key, None)
        if future is None:
            return
        if error is None:
            future.set_result(None)
        else:
            future.set_exception(error)


def format_error(error: BaseException) -> str:
    """The text of a worker's error in the queue; `_parse_error` reads it."""
    return f"{type(error).__name__}: {error}"


def _parse_error(state: State | None) -> Exception | None:
    """The error of a finished task; None if it succeeded."""
    if state is None:
        return None
    fault = state.fault or f"a worker left it {state.status}"
    kind, _, message = fault.partition(": ")
    if kind == StoreAwayError.__name__:
        # As if the store had been away for this server: the caller may retry.
        return StoreAwayError(message)
    return WorkerFailedError(fault)
