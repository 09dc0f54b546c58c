"""Recordings in a folder of this machine."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

from .store import Errand

#: Names that mean the same to every proxy, encoded or not, and lead nowhere else: a hash and an
#: ending. All names are such, unless somebody finds a way to another one: that we send ourselves.
_PLAIN = re.compile(r"[0-9a-z]+\.[0-9a-z]+", re.ASCII)


class FolderStore:
    """A `Store` over one folder. Folders within it are somebody else's.

    address: of the folder at a proxy that sends its files in our place, such as /videos/own; none
    if we send them.
    """

    origin: str | None = None

    def __init__(self, folder: Path, address: str | None = None) -> None:
        self._folder = folder
        self._address = address

    def at_hand(self, name: str) -> bool:
        return (self._folder / name).is_file()

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        return {name: (self._folder / name).stat().st_size for name in names if self.at_hand(name)}

    def put(self, name: str, file: Path) -> None:
        target = self._folder / name
        if target.exists():
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f"{target.name}.{os.getpid()}.part")
        shutil.copyfile(file, part)
        part.replace(target)

    def bring(self, name: str, target: Path) -> bool:
        """Without a copy where the disk can do that: nothing ever writes into a kept file."""
        if not self.at_hand(name):
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(self._folder / name, target)
        except OSError:
            shutil.copyfile(self._folder / name, target)
        return True

    def throw_away(self, names: Iterable[str]) -> None:
        for name in names:
            (self._folder / name).unlink(missing_ok=True)

    def hand_out(self, name: str, *, head: bool) -> Path | Errand:
        if self._address is None or not _PLAIN.fullmatch(name):
            return self._folder / name
        return Errand(f"{self._address}/{name}")

    def fault(self) -> str | None:
        """None: whether the studio's folders can be written to is looked at for all of them."""
        return None

    def close(self) -> None:
        pass
