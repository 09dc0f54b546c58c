"""Child processes: how they start, and their setup: lower priority, exit with the parent."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Hashable
from concurrent.futures import Future
from functools import cache
from multiprocessing.context import ForkServerContext, SpawnContext
from typing import Any

log = logging.getLogger(__name__)

#: Imported once by the process that children are forked from: all that their functions need.
PRELOADED = ("app.services.bootstrap",)


@cache
def child_context() -> ForkServerContext | SpawnContext:
    """The context in which child processes are started.

    Children are forked from one process that has imported the application and has no threads: a
    fork of the server itself would copy locks that its other threads hold. They start in
    milliseconds and share that process's memory; a child that imports the application itself takes
    two seconds of CPU time. Platforms without a fork server start a new interpreter for each child.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*PRELOADED])
    return context


def set_up_child_process(yields: int = 10) -> None:
    """Set up this process as a child of a server: call it first in the child.

    The process exits when its parent dies; otherwise the workers of a killed server would wait
    forever. yields: increment of the niceness. On a busy machine, 10 leaves the process a tenth of
    the server's CPU time, 5 a third.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
    # Ctrl+C reaches the whole process group; only the server handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(yields)


def log_failure(key: Hashable, finished: Future[Any]) -> None:
    """Log the exception of a failed future, because its caller may have stopped waiting for it."""
    if not finished.cancelled() and (error := finished.exception()) is not None:
        log.error("background work %r failed", key, exc_info=error)
