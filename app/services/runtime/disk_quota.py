"""Checks for free disk space before large writes.

The database is usually on the same disk, and a full disk would lose responses. Uploads, jobs and
backups are therefore refused before the disk is full.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from .errors import NoRoomError
from .settings import Settings

#: Share of a disk that is kept free, if that is less than the setting says.
_SHARE = 0.1


def require(settings: Settings, folder: Path, coming: int = 0) -> None:
    """Raise NoRoomError if writing `coming` bytes to this folder would leave too little space.

    `keep_free_gb` must stay free, or a tenth of the disk if that is less.
    """
    there = folder.resolve()
    while not there.exists():
        there = there.parent
    usage = shutil.disk_usage(there)
    kept = min(settings.keep_free_gb * 1e9, _SHARE * usage.total)
    if usage.free - coming < kept:
        raise NoRoomError(
            f"expected {_size(coming + kept)} free on the server's disk, of which {_size(kept)} are"
            f" kept for answers, and {_size(usage.free)} are free: ask the people who run the"
            " server, or throw drafts and studies away"
        )


def _size(number: float) -> str:
    return f"{number / 1e9:,.1f} GB" if number >= 1e8 else f"{number / 1e6:,.1f} MB"
