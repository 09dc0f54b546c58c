"""Stores uploaded files: validates names, limits sizes, and unpacks zips without trusting them.

A zip's directory may claim anything: paths outside the folder, links, or a few kilobytes that
expand to a terabyte. Nothing in it is trusted, and all faults are reported together.
"""

from __future__ import annotations

import io
import shutil
import stat
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from app.services.runtime.errors import ServiceError
from app.study.shortening import shortened

from .upload_names import name_conflicts, name_fault, normal
from .zip_layout import Layout, is_left_out, lay_out, named, names_of

#: How many faults an error lists; of the others it gives the number.
MOST_FAULTS_NAMED = 20
#: Files in a zip. More are a mistake, or an attack on the file system's directory entries.
MOST_FILES = 20_000
#: Compression ratio. Text and videos stay below it, so a larger one indicates a zip bomb.
LARGEST_RATIO = 200
#: Bytes up to which the ratio is not checked: a small repetitive file is harmless.
RATIO_COUNTS_FROM = 1_000_000
_PIECE = 1 << 20
_ENCRYPTED = 0x1


class UploadRefusedError(ServiceError):
    """An upload that is refused; `faults` has one sentence for each reason."""

    def __init__(self, faults: Iterable[str]) -> None:
        every = [shortened(fault) for fault in faults]
        more = len(every) - MOST_FAULTS_NAMED
        rest = [f"And {more:,} more faults of this kind."] if more > 0 else []
        self.faults = (*every[:MOST_FAULTS_NAMED], *rest)
        super().__init__(" ".join(self.faults))


def safe_name(name: str) -> str:
    """The name as a relative path within a study folder. Raises UploadRefusedError."""
    fault = name_fault(name)
    if fault is not None:
        raise UploadRefusedError([fault])
    return normal(name).as_posix()


def size_of(folder: Path) -> int:
    """Total size of all files in the folder, in bytes."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def write_file(content: IO[bytes], target: Path, limit: int) -> int:
    """Write an uploaded file to `target`, atomically; return its size in bytes.

    Raises UploadRefusedError if it is larger than `limit` bytes or cannot be written.
    """
    part = target.with_name(f".{target.name}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as file:
                size = _copy(content, file, limit, target.name)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(error) from None
    return size


@dataclass(frozen=True)
class Unpacked:
    """The names of unpacked files, and sentences on what was left out or taken otherwise."""

    names: list[str]
    notes: list[str]


def unpack(packed: IO[bytes], folder: Path, limit: int) -> Unpacked:
    """Unpack a zip into the folder, replacing files of the same names.

    Folders around the study are taken away; hidden files are left out. limit: total bytes allowed.
    Raises UploadRefusedError with all faults, in which case the folder is unchanged.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            every = [entry for entry in archive.infolist() if not entry.is_dir()]
            entries = [entry for entry in every if not is_left_out(entry.filename)]
            if len(entries) > MOST_FILES:
                raise UploadRefusedError(
                    [f"Expected at most {MOST_FILES} files in the zip, got {len(entries)}."]
                )
            if every and not entries:
                raise UploadRefusedError(["Expected files in the zip, got none but hidden ones."])
            sizes = list(_size_faults(packed, entries, limit))
            # A zip that is not what it says is not read, not even its tables.
            names = {one.header_offset: one.filename for one in entries}
            if not sizes:
                names = names_of(archive, entries)
            faults = [*sizes, *_faults(entries, names)]
            if faults:
                raise UploadRefusedError(faults)
            layout = lay_out(names, entries, folder)
            if layout.faults:
                raise UploadRefusedError(layout.faults)
            most = max(RATIO_COUNTS_FROM, LARGEST_RATIO * _size(packed))
            extracted = _extract(archive, layout, folder, min(limit, most))
            notes = list(layout.notes)
            hidden = len(every) - len(entries)
            if hidden:
                what = "a hidden file, or one" if hidden == 1 else f"{hidden} files, hidden or"
                notes.append(f"left out: {what} that a system adds")
            return Unpacked(extracted, notes)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise UploadRefusedError([f"Expected a zip, got a damaged one or none: {error}."]) from None
    except OSError as error:
        raise _unwritable(error) from None


def _unwritable(error: OSError) -> UploadRefusedError:
    said = error.strerror or type(error).__name__
    return UploadRefusedError([f"Expected files that can be written, got: {said}."])


def _extract(archive: zipfile.ZipFile, layout: Layout, folder: Path, limit: int) -> list[str]:
    places = [normal(name) for _, name in layout.places]
    faults = name_conflicts((place.as_posix() for place in places), folder)
    if faults:
        raise UploadRefusedError(faults)
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    names = []
    try:
        left = limit
        for (entry, _), name in zip(layout.places, places, strict=True):
            target = part / name
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(entry) as content, target.open("wb") as file:
                left -= _copy(content, file, left, name.as_posix())
            names.append(name.as_posix())
        for name_ in names:
            (folder / name_).parent.mkdir(parents=True, exist_ok=True)
            (part / name_).replace(folder / name_)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return names


def _copy(content: IO[bytes], file: IO[bytes], limit: int, name: str) -> int:
    size = 0
    while piece := content.read(_PIECE):
        size += len(piece)
        if size > limit:
            raise UploadRefusedError([f"Expected at most {_megabytes(limit)}, and {name} is more."])
        file.write(piece)
    return size


def _size_faults(packed: IO[bytes], entries: list[zipfile.ZipInfo], limit: int) -> Iterable[str]:
    if not entries:
        yield "Expected files in the zip, got none."
    locked = [entry.filename for entry in entries if entry.flag_bits & _ENCRYPTED]
    if locked:
        yield f"Expected files without a password, got {len(locked)} with one: {named(locked, 3)}."
    total = sum(entry.file_size for entry in entries)
    if total > limit:
        came = _megabytes(total)
        yield f"Expected at most {_megabytes(limit)} unpacked, and the zip says {came}."
    size = _size(packed)
    if total > max(RATIO_COUNTS_FROM, LARGEST_RATIO * size):
        yield (
            f"Expected a zip that packs to no less than 1/{LARGEST_RATIO} of what is in it, got"
            f" {_megabytes(size)} that would grow to {_megabytes(total)}."
        )
    for entry in entries:
        is_large = entry.file_size > RATIO_COUNTS_FROM
        if is_large and entry.file_size > LARGEST_RATIO * max(entry.compress_size, 1):
            yield (
                f"Expected files that pack to no less than 1/{LARGEST_RATIO} of their size,"
                f" and {entry.filename!r} would grow to {_megabytes(entry.file_size)}."
            )


def _faults(entries: list[zipfile.ZipInfo], names: Mapping[int, str]) -> Iterable[str]:
    for entry in entries:
        name = names[entry.header_offset]
        fault = name_fault(name)
        if fault is not None:
            yield fault
            continue
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG):
            what = "a link" if kind == stat.S_IFLNK else "something else"
            yield f"Expected plain files in the zip, and {name!r} is {what}."


def _size(packed: IO[bytes]) -> int:
    """The size of the zip file itself, in bytes, whatever its directory claims."""
    here = packed.tell()
    size = packed.seek(0, io.SEEK_END)
    packed.seek(here)
    return size


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB" if size >= 1e6 else f"{size:,} bytes"
