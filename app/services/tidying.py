"""What nobody has promised and everybody expects: that what was begun and left is cleared away."""

from __future__ import annotations

import logging
from collections.abc import Callable

from . import left_videos, old_drafts, unconsented
from .ethics import bundle
from .studio import Studio

log = logging.getLogger(__name__)

#: What is cleared away, in words, and by what.
_SWEEPS: tuple[tuple[str, Callable[[Studio, Callable[[], bool]], int]], ...] = (
    ("sessions that never came to consent", unconsented.sweep),
    ("studies being made that nobody went on with", old_drafts.sweep),
    ("videos that no study has any more", left_videos.sweep),
    ("old counts of faults", lambda studio, _stop: studio.faults.delete_old()),
    ("ethics bundles that nobody has any more", bundle.sweep),
)


def run_quietly(studio: Studio, stop: Callable[[], bool]) -> None:
    """Clear everything away: what goes wrong is logged, and tried again the next time."""
    for name, sweep in _SWEEPS:
        try:
            gone = sweep(studio, stop)
        except Exception:
            log.exception("clearing away %s failed", name)
        else:
            if gone:
                log.info("cleared away %d %s", gone, name)
