"""A store in a local folder."""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from app.services.runtime.errors import StoreAwayError

from .interface import InternalRedirect

#: Names that are safe in a proxy's path without encoding: a hash and an extension. All names should
#: match; a file with another name is sent by this server.
_PLAIN = re.compile(r"[0-9a-z]+\.[0-9a-z]+", re.ASCII)

#: Error numbers that mean that there is no such file.
_NO_SUCH_FILE = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


class FolderStore:
    """A `Store` of the files directly in one folder; subfolders are ignored.

    Methods raise StoreAwayError if the folder cannot be read or written.

    address: internal path of the folder at a proxy that sends the files, such as /videos/own; None
    if this server sends them.
    """

    origin: str | None = None

    def __init__(self, folder: Path, address: str | None = None) -> None:
        self._folder = folder
        self._address = address

    def exists_cached(self, name: str) -> bool | None:
        try:
            return self._size(name) is not None
        except StoreAwayError:
            return None

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        held = {name: self._size(name) for name in names}
        return {name: size for name, size in held.items() if size is not None}

    def put(self, name: str, file: Path) -> None:
        """Copy the file and flush it to disk, so that the source may be deleted afterwards."""
        target = self._folder / name
        part = target.with_name(f"{target.name}.{os.getpid()}.part")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            # A file of another size is incomplete, for example after a power cut.
            if self._size(name) == file.stat().st_size:
                return
            shutil.copyfile(file, part)
            _force_to_disk(part)
            part.replace(target)
            # Flush the directory entry too, where the file system supports that.
            with suppress(OSError):
                _force_to_disk(target.parent)
        except OSError as error:
            with suppress(OSError):
                part.unlink()
            raise StoreAwayError(f"the video could not be kept: {error.strerror}") from error

    def copy_to(self, name: str, target: Path) -> bool:
        """Hard-link the file if possible, otherwise copy it: stored files are never modified."""
        if self._size(name) is None:
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(self._folder / name, target)
        except FileNotFoundError:
            return False
        except OSError:
            shutil.copyfile(self._folder / name, target)
        return True

    def delete(self, names: Iterable[str]) -> None:
        for name in names:
            try:
                (self._folder / name).unlink(missing_ok=True)
            except OSError as error:
                raise StoreAwayError(f"a video could not be deleted: {error.strerror}") from error

    def serve(self, name: str, *, head: bool) -> Path | InternalRedirect:
        if self._address is None or not _PLAIN.fullmatch(name):
            return self._folder / name
        return InternalRedirect(f"{self._address}/{name}")

    def fault(self) -> str | None:
        """None: `monitoring.health` checks all local folders."""
        return None

    def close(self) -> None:
        pass

    def _size(self, name: str) -> int | None:
        """Size in bytes; None if there is no file. One system call: the file may go at any time."""
        try:
            status = (self._folder / name).stat()
        except OSError as error:
            if error.errno in _NO_SUCH_FILE:
                return None
            raise StoreAwayError(f"the videos cannot be read: {error.strerror}") from error
        return status.st_size if stat.S_ISREG(status.st_mode) else None


def _force_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
