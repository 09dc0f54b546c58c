"""Files that came from a browser: named harmlessly, limited in size, unpacked without trust.

A zip may say anything of what is in it: that its files lie elsewhere on the disk, that they are
links, that a few kilobytes are a terabyte. Nothing it says is believed, and everything that is
wrong with it is named at once.
"""

from __future__ import annotations

import io
import shutil
import stat
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import IO

from app.services.runtime.errors import ServiceError
from app.study.shortening import shortened

from .upload_names import name_conflicts, name_fault, normal

#: How many faults a refusal names; it counts the others.
MOST_FAULTS_NAMED = 20
#: A study of more files than this is a slip, or meant to fill the disk with names.
MOST_FILES = 20_000
#: Text and videos pack to no less than this part of their size; what packs better is a bomb.
LARGEST_RATIO = 200
#: Below this size a high ratio does no harm: a small file of one letter packs very well.
RATIO_COUNTS_FROM = 1_000_000
_PIECE = 1 << 20
#: What systems leave in zips of their own accord.
_OS_METADATA = ("__MACOSX", ".DS_Store", "Thumbs.db", "desktop.ini")
_ENCRYPTED = 0x1


class UploadRefusedError(ServiceError):
    """What was sent cannot be taken; `faults` says why, one sentence each."""

    def __init__(self, faults: Iterable[str]) -> None:
        every = [shortened(fault) for fault in faults]
        more = len(every) - MOST_FAULTS_NAMED
        rest = [f"And {more:,} more faults of this kind."] if more > 0 else []
        self.faults = (*every[:MOST_FAULTS_NAMED], *rest)
        super().__init__(" ".join(self.faults))


def safe_name(name: str) -> str:
    """The name as a path within a study's folder. Raises UploadRefusedError."""
    fault = name_fault(name)
    if fault is not None:
        raise UploadRefusedError([fault])
    return normal(name).as_posix()


def size_of(folder: Path) -> int:
    """Bytes in the folder's files."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def keep(content: IO[bytes], target: Path, limit: int) -> int:
    """Write what was sent into a file, in the place of one of its name; its size in bytes.

    The file appears whole or not at all. Raises UploadRefusedError beyond `limit` bytes, or
    where no file can be written.
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


def unpack(packed: IO[bytes], folder: Path, limit: int) -> list[str]:
    """Unpack a zip into the folder, over files of the same names; the names.

    A single folder around everything, as systems make it, is left out. Raises UploadRefusedError
    with every fault, and leaves the folder as it was then. limit: bytes that all may take.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            entries = [entry for entry in archive.infolist() if not _is_os_metadata(entry)]
            faults = list(_faults(packed, entries, limit))
            if faults:
                raise UploadRefusedError(faults)
            most = max(RATIO_COUNTS_FROM, LARGEST_RATIO * _size(packed))
            return _extract(archive, entries, folder, min(limit, most))
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise UploadRefusedError([f"Expected a zip, got a damaged one or none: {error}."]) from None
    except OSError as error:
        raise _unwritable(error) from None


def _unwritable(error: OSError) -> UploadRefusedError:
    said = error.strerror or type(error).__name__
    return UploadRefusedError([f"Expected files that can be written, got: {said}."])


def _extract(
    archive: zipfile.ZipFile, entries: list[zipfile.ZipInfo], folder: Path, limit: int
) -> list[str]:
    root = _common_root([entry.filename for entry in entries])
    places = [normal(entry.filename).relative_to(root) for entry in entries]
    faults = name_conflicts((place.as_posix() for place in places), folder)
    if faults:
        raise UploadRefusedError(faults)
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    names = []
    try:
        left = limit
        for entry, name in zip(entries, places, strict=True):
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


def _faults(packed: IO[bytes], entries: list[zipfile.ZipInfo], limit: int) -> Iterable[str]:
    if not entries:
        yield "Expected files in the zip, got none."
    if len(entries) > MOST_FILES:
        yield f"Expected at most {MOST_FILES} files in the zip, got {len(entries)}."
        return
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
        name = entry.filename
        fault = name_fault(name)
        if fault is not None:
            yield fault
            continue
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG):
            what = "a link" if kind == stat.S_IFLNK else "something else"
            yield f"Expected plain files in the zip, and {name!r} is {what}."
        if entry.flag_bits & _ENCRYPTED:
            yield f"Expected files without a password, and {name!r} has one."
        is_large = entry.file_size > RATIO_COUNTS_FROM
        if is_large and entry.file_size > LARGEST_RATIO * max(entry.compress_size, 1):
            yield (
                f"Expected files that pack to no less than 1/{LARGEST_RATIO} of their size,"
                f" and {name!r} would grow to {_megabytes(entry.file_size)}."
            )
    yield from name_conflicts(
        entry.filename for entry in entries if name_fault(entry.filename) is None
    )


def _size(packed: IO[bytes]) -> int:
    """Bytes of the zip itself, whatever it says of its parts."""
    here = packed.tell()
    size = packed.seek(0, io.SEEK_END)
    packed.seek(here)
    return size


def _is_os_metadata(entry: zipfile.ZipInfo) -> bool:
    parts = PurePosixPath(entry.filename).parts
    return entry.is_dir() or any(part in _OS_METADATA for part in parts)


def _common_root(names: list[str]) -> PurePosixPath:
    """The one folder that everything is in, if everything is in one and the study is no higher."""
    paths = [normal(name) for name in names]
    first = paths[0].parts[0]
    has_root = all(len(path.parts) > 1 and path.parts[0] == first for path in paths)
    return (
        PurePosixPath(first) if has_root and first not in ("texts", "videos") else PurePosixPath()
    )


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB" if size >= 1e6 else f"{size:,} bytes"
