"""Finds the table that a plan's `source` means: another case or ending is understood if unique."""

from __future__ import annotations

from pathlib import Path

from .files import is_file
from .tables import TABLE_ENDINGS


def find_source(root: Path, source: str) -> Path:
    """The path of the table: as named, in another case, or with another ending of tables.

    The path as named if there is no such file, or more than one.
    """
    path = root / source
    if is_file(path) or not path.parent.is_dir():
        return path
    there = [one for one in sorted(path.parent.iterdir()) if is_file(one)]
    same = [one for one in there if one.name.casefold() == path.name.casefold()]
    if not same:
        stem = path.stem.casefold()
        same = [
            one
            for one in there
            if one.stem.casefold() == stem and one.suffix.lower() in TABLE_ENDINGS
        ]
    return same[0] if len(same) == 1 else path
