"""Reads a file only if no disk has to be waited for, so that the event loop may do it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

#: Flag of preadv that makes it fail instead of waiting for a disk. Linux alone has it.
_NOWAIT: Final = getattr(os, "RWF_NOWAIT", None)


def read(file: Path, most: int) -> bytes | None:
    """The content of a file that is in the kernel's page cache, otherwise None.

    It is None too for files that are missing, empty or longer than `most` bytes, and where the
    system or the file system cannot tell.
    """
    if _NOWAIT is None:
        return None
    with suppress(OSError):
        descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
        try:
            size = os.fstat(descriptor).st_size
            if 0 < size <= most:
                content = bytearray(size)
                if os.preadv(descriptor, [content], 0, _NOWAIT) == size:
                    return bytes(content)
        finally:
            os.close(descriptor)
    return None
