"""What a process that decodes videos may take of the machine."""

from __future__ import annotations

import math
import os
import resource
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

#: Each thread that decodes holds pictures of its own: more would fill the memory first.
_MOST_THREADS = 4
#: A video, what is written of it, and what the interpreter opens by itself.
_MOST_FILES = 64


@dataclass(frozen=True)
class Limits:
    """What one video may take. silent_s: for so long the process may say nothing."""

    memory_bytes: int
    silent_s: float
    processor_s: int
    file_bytes: int


#: Enough for the worst that was measured: 2.0 GB for H.264 of 50 million pixels, the largest that
#: are taken, each referring to sixteen others.
PROBING = Limits(memory_bytes=2 << 30, silent_s=120.0, processor_s=240, file_bytes=0)
#: Nothing is decoded; a video of an hour may be large.
REMUXING = Limits(memory_bytes=2 << 30, silent_s=300.0, processor_s=600, file_bytes=8 << 30)
#: An hour of video at the slowest that was met: two seconds of processor for each of its own.
TRANSCODING = Limits(memory_bytes=2 << 30, silent_s=120.0, processor_s=7200, file_bytes=8 << 30)


def keep_to(limits: Limits) -> None:
    """Keep this process to `limits` from now on; what it has used of the processor is forgiven."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    spent_s = math.ceil(used.ru_utime + used.ru_stime)
    for kind, most in (
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CPU, spent_s + limits.processor_s),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        (resource.RLIMIT_NOFILE, _MOST_FILES),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        # Not every system knows every limit; the time that a video may take is watched besides.
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (soft, hard))


def be_the_first_to_go() -> None:
    """Where memory runs out, let the system end this process rather than the server."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def threads() -> int:
    """In how many threads a video is decoded or encoded."""
    return min(_MOST_THREADS, os.cpu_count() or 1)
