"""Videos that whoever wrote them left unfinished, killed in the middle: removed after a day.

They lie beside the videos under names that no video has, so they are never shown, and only take
room. Each process looks through its own machine's folders.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import partial
from pathlib import Path

from .repeating import repeated
from .studio import Studio

log = logging.getLogger(__name__)

#: Whatever is still being written was written to since.
KEPT = timedelta(days=1)
#: Between two looks, in seconds.
PERIOD_S = 3600.0

#: What a video is called while it is written: by the hash of what it shows, and by who writes it.
_UNFINISHED = re.compile(r"\.?[0-9a-f]{32,64}\.(\w+\.)+part")


def sweep(studio: Studio, stop: Callable[[], bool] = lambda: False) -> int:
    """Remove what is left; how many files went. stop: asked before each; True ends the sweep."""
    written_before = (studio.now() - KEPT).timestamp()
    gone = 0
    for folder in (studio.settings.media_dir, studio.settings.own_videos):
        for path in _unfinished(folder):
            if stop():
                return gone
            try:
                if path.stat().st_mtime <= written_before:
                    path.unlink()
                    gone += 1
            except FileNotFoundError:
                pass  # another process was quicker: to finish it, or to remove it
            except OSError as error:
                log.error("an unfinished video cannot be removed: %s", error)
    if gone:
        log.info("removed %d unfinished videos", gone)
    return gone


@contextmanager
def swept_hourly(studio: Studio) -> Iterator[None]:
    """Within this, unfinished videos are removed by themselves: at once, and then every hour."""
    with repeated("removing unfinished videos", PERIOD_S, partial(sweep, studio)):
        yield


def _unfinished(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.part") if _UNFINISHED.fullmatch(path.name)]
