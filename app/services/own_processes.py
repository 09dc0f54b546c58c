"""What every process that works for a server keeps to: it leaves with its server, and may yield."""

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


def yield_to_pages(by: int = 10) -> None:
    """As `end_with_parent`, for work that must not take the processor from a page.

    by: how much it yields; at 10 a busy machine gives it a tenth of what a page gets, at 5 a third.
    """
    end_with_parent()
    os.nice(by)


def log_fault(key: Hashable, finished: Future[Any]) -> None:
    """Log why work failed: whoever asked for it may not be listening any more."""
    if not finished.cancelled() and (error := finished.exception()) is not None:
        log.error("background work %r failed", key, exc_info=error)
