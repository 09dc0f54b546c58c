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


def end_with_parent() -> None:
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


def log_fault(key: Hashable, finished: Future[Any]) -> None:
    """Log why work failed: whoever asked for it may not be listening any more."""
    if not finished.cancelled() and (error := finished.exception()) is not None:
        log.error("background work %r failed", key, exc_info=error)
