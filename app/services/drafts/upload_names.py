"""Validates the names of uploaded files before they reach a file system.

A name is accepted only if it means the same file on every system to which a study may be moved: it
fits a directory entry in bytes, is not reserved by a system, and differs from its siblings in more
than case.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

#: Characters of a path; not every file system takes more.
LONGEST_NAME = 200
#: Bytes of UTF-8 in one part of a path: file systems take 255, and a file being written has 6 more.
LONGEST_PART = 240
#: Parts of a path; those of a study's texts are three.
DEEPEST = 10
#: Names that Windows reserves for devices, with any extension.
_DEVICES = frozenset(
    {"con", "prn", "aux", "nul"}
    | {f"{device}{number}" for device in ("com", "lpt") for number in range(10)}
)


def normal(name: str) -> PurePosixPath:
    """The name as a path in Unicode normalisation form C."""
    return PurePosixPath(unicodedata.normalize("NFC", name))


def name_fault(name: str) -> str | None:
    """Why this name is not allowed, as a sentence; None if it is."""
    path = normal(name)
    parts = path.parts
    wrong = (
        (not parts or not name.strip(), "Expected files with a name, got one without."),
        (
            len(name) > LONGEST_NAME,
            f"Expected names of at most {LONGEST_NAME} characters, got {name[:40]!r}...",
        ),
        (
            path.is_absolute() or (parts and ":" in parts[0]),
            f"Expected names within the study's folder, got the absolute {name!r}.",
        ),
        (
            ".." in parts,
            f"Expected names within the study's folder, and {name!r} leads out of it.",
        ),
        ("\\" in name, f"Expected names with forward slashes, got {name!r}."),
        (
            any(unicodedata.category(letter).startswith("C") for letter in name),
            f"Expected names of letters that can be seen, got {name!r}.",
        ),
        (any(part.startswith(".") for part in parts), f"Expected no hidden files, got {name!r}."),
        (
            len(parts) > DEEPEST,
            f"Expected files at most {DEEPEST - 1} folders deep, got {name!r}.",
        ),
    )
    found = next((message for is_wrong, message in wrong if is_wrong), None)
    return found or next(filter(None, (_part_fault(part, name) for part in parts)), None)


def _part_fault(part: str, name: str) -> str | None:
    size = len(part.encode("utf-8"))
    if size > LONGEST_PART:
        return (
            f"Expected names of at most {LONGEST_PART} bytes (80 letters of Japanese), got {size}:"
            f" {part[:20]!r}..."
        )
    if part != part.strip() or part.endswith("."):
        return f"Expected names without a space or a full stop at an end, got {name!r}."
    if part.partition(".")[0].strip().casefold() in _DEVICES:
        return f"Expected a name that Windows does not keep for itself, got {name!r}."
    return None


def name_conflicts(names: Iterable[str], folder: Path | None = None) -> list[str]:
    """Why these files cannot be in one folder together, or with those in `folder`; a sentence each.

    An existing file with the same name is no conflict, since it is replaced.
    """
    spelled: dict[str, str] = {}
    files: set[str] = set()
    folders: set[str] = set()
    found = []
    for name in names:
        path = normal(name)
        whole = path.as_posix()
        above = [parent.as_posix() for parent in path.parents][:-1]
        other = next(
            (
                spelled[key]
                for key in (_folded(one) for one in (whole, *above))
                if key in spelled and spelled[key] not in (whole, *above)
            ),
            None,
        ) or (_on_disk(folder, path) if folder is not None else None)
        if whole in files or other is not None:
            found.append(f"Expected each file once, got {whole!r} and {other or whole!r}.")
        elif whole in folders or files.intersection(above):
            first = whole if whole in folders else next(iter(files.intersection(above)))
            found.append(f"Expected a file or a folder, got both of {first!r}.")
        elif folder is not None and (kind := _kind_fault(folder, path)) is not None:
            found.append(kind)
        files.add(whole)
        folders.update(above)
        spelled.update({_folded(one): one for one in (whole, *above)})
    return found


def _folded(path: str) -> str:
    # On many systems, names that differ in case only are the same file.
    return unicodedata.normalize("NFC", path.casefold())


def _on_disk(folder: Path, path: PurePosixPath) -> str | None:
    """An existing path that differs from this one, or from one of its parents, in case only."""
    here = folder
    for part in path.parts:
        if not here.is_dir():
            return None
        if not (here / part).exists():
            for entry in here.iterdir():
                if entry.name != part and _folded(entry.name) == _folded(part):
                    return entry.relative_to(folder).as_posix()
            return None
        here /= part
    return None


def _kind_fault(folder: Path, path: PurePosixPath) -> str | None:
    """Why the path cannot be written: a folder exists at it, or a file at one of its parents."""
    if (folder / path).is_dir():
        return f"Expected a file, and {path.as_posix()!r} is a folder of this study."
    for parent in path.parents:
        if (folder / parent).is_file():
            return f"Expected a folder, and {parent.as_posix()!r} is a file of this study."
    return None
