"""Where the files of a zip belong in a study's folder, whatever program packed them.

Names in other code pages are decoded as the zip's own tables name the files. Folders around the
study are taken away, hidden files and those that systems add are left out.
"""

from __future__ import annotations

import re
import unicodedata
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from app.study.folder import TEXT_NAMES, WELCOME
from app.study.plan_source import STUDY_FILE
from app.study.table_headers import VIDEO_ENDINGS
from app.study.tables import TABLE_ENDINGS

#: The flag of an entry whose name is in UTF-8; others are in the code page of whoever packed them.
_UTF_8: Final = 0x800
#: What zipfile decodes other names as, and the code pages that people's systems write.
_CP437: Final = "cp437"
_CODE_PAGES: Final = (
    "utf-8",
    "cp437",
    "cp932",
    "cp1252",
    "cp850",
    "gb18030",
    "euc-kr",
    "mac-roman",
)
#: Names that systems add.
_OF_SYSTEMS: Final = frozenset({"__macosx", "thumbs.db", "desktop.ini", "ehthumbs.db"})
_PLANS: Final = (STUDY_FILE, "study.yml")
_LANGUAGE: Final = re.compile(r"[a-z]{2,3}(-[A-Za-z0-9]{2,8})*", re.IGNORECASE)
_MOST_TABLE_BYTES: Final = 2_000_000
_MOST_TABLES: Final = 20


@dataclass(frozen=True)
class Layout:
    """The path of each entry in the study's folder, and what was left out or renamed, in words.

    faults: why the files cannot be laid out.
    """

    places: tuple[tuple[zipfile.ZipInfo, str], ...]
    notes: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()


def is_left_out(name: str) -> bool:
    """Whether a file of this name is hidden, or added by a system."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    return any(
        part.casefold() in _OF_SYSTEMS or (part.startswith(".") and part not in (".", ".."))
        for part in parts
    )


def names_of(archive: zipfile.ZipFile, entries: Sequence[zipfile.ZipInfo]) -> dict[int, str]:
    """The name of each entry by its offset, with forward slashes, in the most likely code page."""
    undecoded = [
        entry for entry in entries if not entry.flag_bits & _UTF_8 and not entry.filename.isascii()
    ]
    encoding = _code_page(archive, entries, undecoded) if undecoded else _CP437
    others = {id(entry) for entry in undecoded}
    return {
        entry.header_offset: _decoded(entry, encoding if id(entry) in others else _CP437).replace(
            "\\", "/"
        )
        for entry in entries
    }


def lay_out(names: dict[int, str], entries: Sequence[zipfile.ZipInfo], folder: Path) -> Layout:
    """The places of the entries in a study's folder that may have files already."""
    paths = {entry.header_offset: PurePosixPath(names[entry.header_offset]) for entry in entries}
    plans = [path for path in paths.values() if path.name.casefold() in _PLANS]
    notes: list[str] = []
    if len(plans) > 1:
        listed = " and ".join(str(path) for path in plans[:3])
        fault = f"Expected one study in the zip, got {listed}: send one of them."
        return Layout((), faults=(fault,))
    root = plans[0].parent if plans else _common_root(list(paths.values()))
    places = []
    outside = []
    for entry in entries:
        path = paths[entry.header_offset]
        if not path.is_relative_to(root):
            outside.append(path.as_posix())
            continue
        place = path.relative_to(root)
        usual = usual_place(place.as_posix())
        if usual != place.as_posix() and not (folder / usual).exists():
            notes.append(f"{path.as_posix()} is taken as {usual}")
            place = PurePosixPath(usual)
        places.append((entry, place.as_posix()))
    if outside:
        notes.append(f"left out, since they lie outside the study's folder: {named(outside)}")
    return Layout(tuple(places), tuple(notes))


def usual_place(name: str) -> str:
    """The path that the study's plan or text has, if it is written in another case or ending."""
    path = PurePosixPath(name)
    folded = path.name.casefold()
    if len(path.parts) == 1 and folded in _PLANS:
        return STUDY_FILE
    stem, _, ending = folded.rpartition(".")
    if len(path.parts) == 3 and path.parts[0].casefold() == "texts":
        language = path.parts[1]
        if _LANGUAGE.fullmatch(language) and ending == "md" and stem in (WELCOME, *TEXT_NAMES):
            first, *rest = language.split("-")
            return f"texts/{'-'.join([first.lower(), *rest])}/{folded}"
    return name


def named(names: Sequence[str], most: int = 10) -> str:
    """The names, or the first of them and the number of the others."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def _common_root(paths: Sequence[PurePosixPath]) -> PurePosixPath:
    """The folders around all files. One that is a study's own (texts, videos) is none of them."""
    root = PurePosixPath()
    while paths:
        depth = len(root.parts)
        first = paths[0].parts[depth] if len(paths[0].parts) > depth + 1 else None
        if first is None or first.casefold() in ("texts", "videos"):
            break
        if not all(len(path.parts) > depth + 1 and path.parts[depth] == first for path in paths):
            break
        root /= first
    return root


def _code_page(
    archive: zipfile.ZipFile,
    entries: Sequence[zipfile.ZipInfo],
    undecoded: Sequence[zipfile.ZipInfo],
) -> str:
    """The code page in which most names occur in the zip's tables; else the first that decodes."""
    listed = [
        entry
        for entry in entries
        if entry.filename.lower().endswith(TABLE_ENDINGS) and not entry.flag_bits & 1
    ]
    tables = [archive.open(entry).read(_MOST_TABLE_BYTES) for entry in listed[:_MOST_TABLES]]
    found: list[tuple[int, str]] = []
    for encoding in _CODE_PAGES:
        try:
            names = [
                PurePosixPath(_decoded(entry, encoding).replace("\\", "/")).name
                for entry in undecoded
            ]
        except UnicodeDecodeError:
            continue
        found.append((sum(_is_named(name, tables) for name in names), encoding))
    best = max((number for number, _ in found), default=0)
    return next((encoding for number, encoding in found if number == best), _CP437)


def _is_named(name: str, tables: Sequence[bytes]) -> bool:
    """Whether a table holds the name, in the encodings in which tables are saved."""
    stem = (
        name[: -len(PurePosixPath(name).suffix)] if name.lower().endswith(VIDEO_ENDINGS) else name
    )
    forms = {unicodedata.normalize("NFC", stem), unicodedata.normalize("NFD", stem)}
    for encoding in ("utf-8", "cp932", "cp1252", "utf-16-le", "utf-16-be"):
        for form in forms:
            try:
                wanted = form.encode(encoding)
            except UnicodeEncodeError:
                continue
            if any(wanted in table for table in tables):
                return True
    return False


def _decoded(entry: zipfile.ZipInfo, encoding: str) -> str:
    if entry.flag_bits & _UTF_8 or entry.filename.isascii() or encoding == _CP437:
        return entry.filename
    return entry.filename.encode(_CP437).decode(encoding)
