"""Videos that whoever wrote them left unfinished, killed in the middle: removed after a day.

They lie beside the videos under names that no video has, so they are never shown, and only take
room. Each process looks through its own machine's folders.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

from app.services.context import AppContext

log = logging.getLogger(__name__)

#: Whatever is still being written was written to since.
KEPT = timedelta(days=1)

#: What a video is called while it is written: by the hash of what it shows, and by who writes it.
_UNFINISHED = re.compile(r"\.?[0-9a-f]{32,64}\.(\w+\.)+part")


def sweep(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Remove what is left; how many files went. stop: asked before each; True ends the sweep."""
    written_before = (app.now() - KEPT).timestamp()
    gone = 0
    for folder in (app.settings.media_dir, app.settings.own_videos):
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
    return gone


def _unfinished(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.part") if _UNFINISHED.fullmatch(path.name)]
