"""Finds the file that a cell of a table means.

Names are compared without regard to case, Unicode normal form and the direction of slashes. A path
of another computer, a bare name and a name without its ending are understood if one file alone can
be meant.
"""

from __future__ import annotations

import difflib
import unicodedata
from collections import defaultdict
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Final

from .files import is_file, misplaced, within
from .shortening import quoted
from .table_headers import VIDEO_ENDINGS

#: A folder with more files is no study's.
MOST_FILES: Final = 100_000
_BESIDE: Final = (".csv", ".tsv", ".xlsx", ".yaml", ".yml", ".md", ".txt")


class NoFileError(Exception):
    """A cell that means no file of the folder; the message says what was expected and what came.

    cause: equal for cells that are wrong for the same reason.
    """

    def __init__(self, message: str, cause: str) -> None:
        super().__init__(message)
        self.cause = cause


class FileLookup:
    """The files of a study's folder by what their names can be written as."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of all files, without folders."""
        return frozenset(PurePosixPath(path).name for path in self._paths)

    @cached_property
    def _paths(self) -> tuple[str, ...]:
        found = []
        for path in sorted(self.root.rglob("*"))[:MOST_FILES]:
            place = path.relative_to(self.root)
            if not any(part.startswith(".") for part in place.parts) and is_file(path):
                found.append(place.as_posix())
        return tuple(found)

    @cached_property
    def _by_name(self) -> dict[str, list[str]]:
        """Paths by the key of their name, and of their name without its ending."""
        found: dict[str, list[str]] = defaultdict(list)
        for path in self._paths:
            name = PurePosixPath(path)
            if name.suffix.lower() in _BESIDE:
                continue
            for one in {key(name.name), key(name.stem)}:
                found[one].append(path)
        return found

    def find(self, base: Path, cell: str) -> Path:
        """The file that a cell means in a table in the folder `base`. Raises NoFileError."""
        problem = misplaced(cell)
        if problem is None:
            path = base / cell
            if not within(self.root, path):
                message = f"expected a file inside the study folder, got the link {quoted(cell)}"
                raise NoFileError(message, "outside")
            if is_file(path):
                return path
        found = self._meant(cell)
        if len(found) == 1:
            path = self.root / found[0]
            if within(self.root, path):
                return path
        if len(found) > 1:
            names = ", ".join(found[:3]) + (", ..." if len(found) > 3 else "")
            raise NoFileError(
                f"expected one file, {quoted(cell)} can mean {names}", "several files"
            )
        if "://" in cell:
            message = f"expected a file in the study folder, got the address {quoted(cell)}"
            raise NoFileError(message, "address")
        if problem is not None and "\\" not in cell:
            raise NoFileError(problem, "misplaced")
        near = self._near(cell)
        hint = f" (did you mean {quoted(near)}?)" if near else ""
        raise NoFileError(f"expected a video, there is no file {quoted(cell)}{hint}", "no file")

    def _meant(self, cell: str) -> list[str]:
        """The paths that share the longest end with the cell's path."""
        if "://" in cell or not cell.strip():
            return []
        parts = [key(part) for part in cell.replace("\\", "/").split("/") if part not in ("", ".")]
        if not parts:
            return []
        found = self._by_name.get(parts[-1], [])
        if not found:
            return []
        # A whole name counts for more than one without its ending.
        whole = [path for path in found if key(PurePosixPath(path).name) == parts[-1]]
        found = whole or found
        shared = [
            _shared([key(part) for part in PurePosixPath(path).parts[:-1]], parts[:-1])
            for path in found
        ]
        return [path for path, number in zip(found, shared, strict=True) if number == max(shared)]

    def _near(self, cell: str) -> str | None:
        name = PurePosixPath(cell.replace("\\", "/")).name
        videos = [one for one in self.names if one.casefold().endswith(VIDEO_ENDINGS)]
        near = difflib.get_close_matches(name, videos[:2_000], n=1, cutoff=0.85)
        return near[0] if near else None


def key(name: str) -> str:
    """What names of files are compared by."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold()).strip()


def _shared(one: list[str], other: list[str]) -> int:
    """How many parts two paths share at their ends."""
    number = 0
    for a, b in zip(reversed(one), reversed(other), strict=False):
        if a != b:
            break
        number += 1
    return number
