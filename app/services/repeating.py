"""What a server does again and again, in a thread of its own, for as long as it runs."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)


@contextmanager
def repeated(
    name: str, period_s: float, do: Callable[[Callable[[], bool]], object]
) -> Iterator[None]:
    """Within this, `do` is called: at once, and then `period_s` seconds after each call's end.

    It is handed a function that says whether it should stop. What goes wrong is logged, and tried
    again the next time. The end waits for the call that is under way: the database is closed then.
    """
    stopping = threading.Event()

    def keep_doing() -> None:
        while not stopping.is_set():
            try:
                do(stopping.is_set)
            except Exception:
                log.exception("%s failed, and is tried again", name)
            stopping.wait(period_s)

    thread = threading.Thread(target=keep_doing, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()
