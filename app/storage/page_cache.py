"""Files for who does not wait (`patience`): what the machine has of them in its memory anyhow."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from . import patience

#: How the kernel is told to read nothing that it would have to wait for; Linux alone knows it.
_AT_ONCE: Final = getattr(os, "RWF_NOWAIT", None)

#: Its disk would have to be waited for, or cannot tell.
_NOT_AT_ONCE: Final = (errno.EAGAIN, errno.EOPNOTSUPP)


def read(file: Path, most: int) -> bytes | None:
    """All of a file; None where it is empty, or longer than `most` bytes.

    Raises OSError where it cannot be opened or read, and NeedsPatienceError.
    """
    if _AT_ONCE is None:
        raise patience.NeedsPatienceError
    descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
    try:
        size = os.fstat(descriptor).st_size
        if not 0 < size <= most:
            return None
        content = bytearray(size)
        there = os.preadv(descriptor, [content], 0, _AT_ONCE)
    except OSError as error:
        if error.errno in _NOT_AT_ONCE:
            raise patience.NeedsPatienceError from None
        raise
    finally:
        os.close(descriptor)
    if there < size:
        raise patience.NeedsPatienceError
    return bytes(content)
