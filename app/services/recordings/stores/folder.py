"""Recordings in a folder of this machine."""

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

#: Names that mean the same to every proxy, encoded or not, and lead nowhere else: a hash and an
#: ending. All names are such, unless somebody finds a way to another one: that we send ourselves.
_PLAIN = re.compile(r"[0-9a-z]+\.[0-9a-z]+", re.ASCII)

#: How a disk says that there is nothing under a name.
_NO_SUCH_FILE = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


class FolderStore:
    """A `Store` over one folder. Folders within it are somebody else's.

    Raises StoreAwayError where the disk does not let it read or write.

    address: of the folder at a proxy that sends its files in our place, such as /videos/own; none
    if we send them.
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
        """On the disk when this returns: what was copied may be thrown away then."""
        target = self._folder / name
        part = target.with_name(f"{target.name}.{os.getpid()}.part")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            # One of another size is what a power cut left of it.
            if self._size(name) == file.stat().st_size:
                return
            shutil.copyfile(file, part)
            _force_to_disk(part)
            part.replace(target)
            # The name, too. Not every network's folder can be asked for that.
            with suppress(OSError):
                _force_to_disk(target.parent)
        except OSError as error:
            with suppress(OSError):
                part.unlink()
            raise StoreAwayError(f"the video could not be kept: {error.strerror}") from error

    def copy_to(self, name: str, target: Path) -> bool:
        """Without a copy where the disk can do that: nothing ever writes into a kept file."""
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
        """None: whether the studio's folders can be written to is looked at for all of them."""
        return None

    def close(self) -> None:
        pass

    def _size(self, name: str) -> int | None:
        """Bytes of the file; None if there is none. Asked once: it may go at any moment."""
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
