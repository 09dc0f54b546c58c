"""Places uploaded files in a draft's folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from app.study import draft_plan
from app.study.folder import TEXT_NAMES, WELCOME
from app.study.plan_source import STUDY_FILE
from app.study.table_headers import VIDEO_ENDINGS
from app.study.table_parameters import entries_of
from app.study.yaml_source import read_yaml

from . import table_intake, uploads
from .upload_names import name_conflicts
from .uploads import UploadRefusedError
from .zip_layout import is_left_out, named, usual_place

#: The name of a draft's table.
TABLE = "recordings.csv"
#: Hidden file with what is to be said of the last upload.
UPLOAD_NOTES = ".upload.json"


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
    notes: list[str] = []
    hidden = [one.name for one in sent if is_left_out(one.name)]
    if hidden and len(hidden) < len(sent):
        notes.append(f"left out, since they are hidden or added by a system: {named(hidden)}")
        sent = [one for one in sent if not is_left_out(one.name)]
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
            unpacked = uploads.unpack(one.content, folder, left)
            stored.extend(unpacked.names)
            notes.extend(f"{one.name}: {note}" for note in unpacked.notes)
            continue
        uploads.write_file(one.content, folder / place, left)
        stored.append(place)
    (folder / UPLOAD_NOTES).write_text(json.dumps(notes), encoding="utf-8")
    return stored


def upload_notes(folder: Path) -> list[str]:
    """What was left out of the last upload, or taken otherwise than it was named."""
    try:
        found = json.loads((folder / UPLOAD_NOTES).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return list(map(str, found)) if isinstance(found, list) else []


def add_scaffold(folder: Path, title: str, slug: str) -> None:
    """Write what a study folder needs and this one lacks: a plan for its table, and texts."""
    source, parameters = table_intake.parameters_in(folder) or (TABLE, [])
    plan = draft_plan.begin_plan(title, source, parameters, slug)
    for place, text in {**draft_plan.example_texts(), STUDY_FILE: plan}.items():
        path = folder / place
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    table_intake.remember(folder, source, entries_of(read_yaml(plan).data))


def is_zip(one: Sent) -> bool:
    """Whether the file's name ends in .zip."""
    return one.name.lower().endswith(".zip")


def _target_path(folder: Path, name: str) -> str:
    """The path of a file in the folder: that of an existing file of this name, or by its ending."""
    path = PurePosixPath(name)
    usual = usual_place(name)
    if usual != name and not (folder / usual).exists():
        return usual
    if len(path.parts) > 1:
        return name
    same = _files_named(folder, path.name)
    if len(same) == 1:
        return same[0].relative_to(folder).as_posix()
    if path.suffix.lower() in VIDEO_ENDINGS:
        return f"videos/{name}"
    if path.suffix.lower() == ".md" and path.stem.casefold() in (WELCOME, *TEXT_NAMES):
        return f"texts/en/{name.casefold()}"
    return name


def _files_named(folder: Path, name: str) -> list[Path]:
    """All files with this name in the folder and below."""
    return [path for path in folder.rglob("*") if path.name == name and path.is_file()]
