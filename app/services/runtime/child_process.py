"""Setup of child processes: lower priority, exit when the parent dies, SIGINT ignored."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Hashable
from concurrent.futures import Future
from typing import Any

log = logging.getLogger(__name__)


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
