"""Creates files and folders that only their owner can access, whatever the umask."""

from __future__ import annotations

import os
from io import BufferedWriter
from pathlib import Path

FILE_MODE, FOLDER_MODE = 0o600, 0o700


def written(path: Path) -> BufferedWriter:
    """Open a private file for writing; existing content is truncated."""
    return os.fdopen(for_owner(str(path), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb")


def for_owner(path: str, flags: int) -> int:
    """Open a file with these flags, and set its mode to 0600 even if it exists. Returns the fd."""
    descriptor = os.open(path, flags, FILE_MODE)
    os.fchmod(descriptor, FILE_MODE)
    return descriptor


def make_folder(folder: Path) -> None:
    """Create a private folder and its missing parents; existing folders are left unchanged."""
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    for one in reversed(missing):
        one.mkdir(mode=FOLDER_MODE, exist_ok=True)
