"""Asks for free space on a disk before anything large is taken onto it.

The database lies on the same disk as a rule, and a full disk stops answers: what experimenters send
and make ends before that.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from .errors import NoRoomError
from .settings import Settings

#: The share of a disk that is kept free where that is less than the setting says.
_SHARE = 0.1


def require(settings: Settings, folder: Path, coming: int = 0) -> None:
    """Raises NoRoomError if `coming` bytes in this folder would leave its disk too little room.

    Kept free are `keep_free_gb`, or a tenth of the disk if that is less.
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
