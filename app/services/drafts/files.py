"""Places uploaded files in a draft's folder."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from app.study import draft_plan
from app.study.files import misplaced, read_text
from app.study.folder import TEXT_NAMES, WELCOME
from app.study.plan_source import STUDY_FILE
from app.study.recordings import FILE_COLUMN
from app.study.validation_errors import UnreadableFileError

from . import uploads
from .upload_names import name_conflicts, name_fault
from .uploads import UploadRefusedError

VIDEO_ENDINGS = (".mp4", ".m4v", ".mov", ".webm", ".ogv", ".ogg", ".avi", ".mkv", ".mpg", ".mpeg")


@dataclass(frozen=True)
class Sent:
    """An uploaded file, with the name that the browser gave."""

    name: str
    content: IO[bytes]


def store(folder: Path, sent: Sequence[Sent], limit: int) -> list[str]:
    """Write uploaded files into the folder, which may take `limit` bytes; return their paths in it.

    All names are checked before the first file is written. Raises UploadRefusedError.
    """
    names: list[str] = []
    faults: list[str] = []
    for one in sent:
        try:
            names.append(uploads.safe_name(one.name))
        except UploadRefusedError as error:
            faults.extend(error.faults)
    if not faults:
        places = [
            name if is_zip(one) else _target_path(folder, name)
            for name, one in zip(names, sent, strict=True)
        ]
        plain = (place for place, one in zip(places, sent, strict=True) if not is_zip(one))
        faults.extend(name_conflicts(plain, folder))
    if faults:
        raise UploadRefusedError(faults)
    stored: list[str] = []
    for place, one in zip(places, sent, strict=True):
        left = limit - uploads.size_of(folder)
        if is_zip(one):
            stored.extend(uploads.unpack(one.content, folder, left))
            continue
        uploads.write_file(one.content, folder / place, left)
        stored.append(place)
    return stored


def add_scaffold(folder: Path, title: str, slug: str) -> None:
    """Write what a study folder needs and this one lacks: a plan for its CSV, and example texts."""
    tables = sorted(path for path in folder.glob("*.csv"))
    parameters: list[str] = []
    if tables:
        try:
            parameters = draft_plan.parameters_of(read_text(folder, tables[0]))
        except (UnreadableFileError, csv.Error):
            # Left to the check, which reports the fault with its line.
            parameters = []
    source = tables[0].name if tables else "recordings.csv"
    written = {STUDY_FILE: draft_plan.begin_plan(title, source, parameters, slug)}
    for place, text in {**draft_plan.example_texts(), **written}.items():
        path = folder / place
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


def place_files(folder: Path) -> None:
    """Move each video that was uploaded without its folder to the path given in the CSV."""
    for table in folder.glob("*.csv"):
        try:
            rows = csv.DictReader(io.StringIO(read_text(folder, table)))
            named = [(row.get(FILE_COLUMN) or "").strip() for row in rows]
        except (UnreadableFileError, csv.Error):
            continue
        for name in named:
            if (
                misplaced(name) is not None
                or name_fault(name) is not None
                or name_conflicts([name], folder)
            ):
                # Left to the check, which reports the fault.
                continue
            target = folder / name
            if target.exists():
                continue
            found = _files_named(folder, PurePosixPath(name).name)
            if len(found) == 1 and found[0].relative_to(folder).as_posix() not in named:
                target.parent.mkdir(parents=True, exist_ok=True)
                found[0].replace(target)


def is_zip(one: Sent) -> bool:
    """Whether the file's name ends in .zip."""
    return one.name.lower().endswith(".zip")


def _target_path(folder: Path, name: str) -> str:
    """The path of a file in the folder: that of an existing file of this name, or by its ending."""
    path = PurePosixPath(name)
    if len(path.parts) > 1:
        return name
    same = _files_named(folder, path.name)
    if len(same) == 1:
        return same[0].relative_to(folder).as_posix()
    if path.suffix.lower() in VIDEO_ENDINGS:
        return f"videos/{name}"
    if path.suffix == ".md" and path.stem in (WELCOME, *TEXT_NAMES):
        return f"texts/en/{name}"
    return name


def _files_named(folder: Path, name: str) -> list[Path]:
    """All files with this name in the folder and below."""
    return [path for path in folder.rglob("*") if path.name == name and path.is_file()]
