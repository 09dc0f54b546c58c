"""Files and folders for the eyes of the user who makes them, whatever the umask says."""

from __future__ import annotations

import os
from io import BufferedWriter
from pathlib import Path

FILE_MODE, FOLDER_MODE = 0o600, 0o700


def written(path: Path) -> BufferedWriter:
    """The file, opened to be written from its beginning."""
    return os.fdopen(for_owner(str(path), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb")


def for_owner(path: str, flags: int) -> int:
    """A descriptor of the file; one that is there already is closed to others."""
    descriptor = os.open(path, flags, FILE_MODE)
    os.fchmod(descriptor, FILE_MODE)
    return descriptor


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing; one that is there stays as it is."""
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    for one in reversed(missing):
        one.mkdir(mode=FOLDER_MODE, exist_ok=True)
