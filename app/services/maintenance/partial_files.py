"""Deletes partial video files, left by processes that were killed while writing, after a day.

Their names differ from those of videos, so they are never shown and only take up space. Each
process cleans the folders of its own machine.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

from app.services.context import AppContext

log = logging.getLogger(__name__)

#: Files that are still being written have been modified more recently.
KEPT = timedelta(days=1)

#: Names of partial files: the video's hash, and the id of the writing process.
_UNFINISHED = re.compile(r"\.?[0-9a-f]{32,64}\.(\w+\.)+part")


def delete_partial(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete partial files, and return their number. stop: called before each; True ends it."""
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
                pass  # another process has finished or deleted it meanwhile
            except OSError as error:
                log.error("an unfinished video cannot be removed: %s", error)
    return gone


def _unfinished(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.part") if _UNFINISHED.fullmatch(path.name)]
