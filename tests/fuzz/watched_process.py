"""What a process takes of the machine: its memory, and the time of its processors."""

from __future__ import annotations

import os
from pathlib import Path

MEGABYTE = 1_000_000
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class WatchedProcess:
    """A process by its id, as Linux tells of it."""

    def __init__(self, pid: int) -> None:
        self._of = Path("/proc") / str(pid)

    @property
    def memory_mb(self) -> float:
        """What it has of the machine's memory just now."""
        resident = int((self._of / "statm").read_text().split()[1])
        return resident * _PAGE_BYTES / MEGABYTE

    @property
    def processor_s(self) -> float:
        """What it has used of processors since it began."""
        # The name of the program comes first, and may hold blanks.
        told = (self._of / "stat").read_text().rpartition(")")[2].split()
        return (int(told[11]) + int(told[12])) / _TICKS_PER_S
