"""What every process that works for a server keeps to: it yields, and it leaves with its server."""

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
    """Make a worker leave when its server is killed: a pool's workers would wait for ever.

    yields: how much to those who answer pages, as a process's niceness. On a busy machine 10 leaves
    it a tenth of what a page gets, 5 a third.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
    # Ctrl+C reaches the whole group of processes: it is the server's to answer.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(yields)


def log_failure(key: Hashable, finished: Future[Any]) -> None:
    """Log why work failed: whoever asked for it may not be listening any more."""
    if not finished.cancelled() and (error := finished.exception()) is not None:
        log.error("background work %r failed", key, exc_info=error)
