"""Takes tables into a draft: stores them as CSV in UTF-8, and lets an untouched plan follow them.

What was derived from a table is recorded in a hidden file. As long as the plan still says just
that, nobody has edited it, and it is derived again from a newer table.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from ruamel.yaml.comments import CommentedMap

from app.study import numbers
from app.study.file_lookup import FileLookup
from app.study.files import read_text
from app.study.numbers import Doubtful
from app.study.parsed_plan import as_mapping
from app.study.plan_source import STUDY_FILE
from app.study.plan_validation import RESERVED_PARAMETERS
from app.study.table_headers import UnmatchedColumnsError
from app.study.table_parameters import derive, entries_of, has_files
from app.study.tables import TABLE_ENDINGS, Table, read_table
from app.study.validation_errors import UnreadableFileError
from app.study.yaml_edit import UneditableError, edited, set_key
from app.study.yaml_source import YamlSyntaxError, read_yaml

#: Hidden files of a draft: uploads cannot have such names.
NOTES = ".tables.json"
DERIVED = ".derived.json"


def take(folder: Path, stored: Sequence[str]) -> None:
    """Convert the tables among the files just stored, and let an untouched plan follow them."""
    for name in stored:
        if name.lower().endswith(TABLE_ENDINGS):
            _store_plainly(folder, name)
    follow(folder)


def notes(folder: Path) -> dict[str, str]:
    """What was done with each table of the draft when it was stored, by its name."""
    found = _read(folder / NOTES)
    return {name: note for name, note in found.items() if (folder / name).is_file()}


def table_of(folder: Path) -> tuple[str, Table] | None:
    """The draft's table of recordings with its name; None if there is none that can be read.

    A table called recordings comes first, then those with a column of files.
    """
    found = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in TABLE_ENDINGS or not path.is_file():
            continue
        try:
            table = read_table(folder, path, FileLookup(folder).names)
        except UnreadableFileError:
            continue
        if has_files(table):
            found.append((path.stem.casefold() != "recordings", path.name, table))
    return min(found, key=lambda one: one[:2])[1:] if found else None


def parameters_in(folder: Path) -> tuple[str, list[dict[str, object]]] | None:
    """The name of the draft's table, and the parameters that it has; None without either."""
    found = table_of(folder)
    if found is None:
        return None
    name, table = found
    try:
        derived = derive(table, sorted(RESERVED_PARAMETERS))
    except UnmatchedColumnsError:
        return None
    return (name, [one.entry() for one in derived]) if derived else None


def remember(folder: Path, source: str, parameters: Sequence[dict[str, object]]) -> None:
    """Record what the plan was begun with, since nobody wrote it."""
    _write(folder / DERIVED, {"source": source, "parameters": list(parameters)})


def follow(folder: Path, *, is_asked: bool = False) -> bool:
    """Write the table's parameters into the plan unless somebody edited them there.

    is_asked: write them in any case. Returns whether the plan was changed.
    """
    found = parameters_in(folder)
    derived = _read(folder / DERIVED)
    try:
        text = read_text(folder, folder / STUDY_FILE)
        data = read_yaml(text).data
    except (UnreadableFileError, YamlSyntaxError):
        return False
    if found is None or not (is_asked or (derived and _is_untouched(data, derived))):
        return False
    name, parameters = found
    sources = _sources(data)

    def change(plan: CommentedMap) -> None:
        set_key(plan, "parameters", parameters)
        if len(sources) == 1 and not (folder / next(iter(sources.values()))).is_file():
            set_key(plan["environments"][next(iter(sources))], "source", name)

    try:
        new = edited(text, change)
    except UneditableError:
        return False
    remember(folder, name, parameters)
    if new != text:
        (folder / STUDY_FILE).write_text(new, encoding="utf-8")
    return new != text


def differs(folder: Path, data: object) -> bool:
    """Whether the plan has other parameters than its table."""
    found = parameters_in(folder)
    if found is None:
        return False
    said = {str(one.get("name")) for one in entries_of(data)}
    return said != {str(one["name"]) for one in found[1]}


def _is_untouched(data: object, derived: dict[str, Any]) -> bool:
    return entries_of(data) == derived.get("parameters")


def _sources(data: object) -> dict[str, str]:
    """The tables that the plan names, by environment."""
    environments = as_mapping(as_mapping(data).get("environments"))
    return {
        name: source
        for name, environment in environments.items()
        if isinstance(source := as_mapping(environment).get("source"), str)
        and source.lower().endswith(TABLE_ENDINGS)
    }


def _store_plainly(folder: Path, name: str) -> None:
    """Write a table as CSV in UTF-8 with commas and decimal points, if that loses nothing."""
    path = folder / name
    said = _read(folder / NOTES)
    said.pop(name, None)
    try:
        table = read_table(folder, path, FileLookup(folder).names)
    except UnreadableFileError:
        # Left to the check, which reports the fault.
        table = None
    if table is not None and not table.is_plain and not _is_doubtful(table):
        target = path.with_suffix(".csv")
        out = io.StringIO()
        rows = [
            [_plain(table, place, cell) for place, cell in enumerate(line.cells)]
            for line in table.lines
        ]
        csv.writer(out, lineterminator="\n").writerows([table.header.cells, *rows])
        part = target.with_name(f".{target.name}.part")
        part.write_text(out.getvalue(), encoding="utf-8")
        part.replace(target)
        if target != path:
            path.unlink()
        how = "; ".join(table.notes) or "it is read as an Excel workbook"
        note = f"{name}: {how}; it is stored as CSV in UTF-8 with commas and decimal points"
        said[target.relative_to(folder).as_posix()] = note
    _write(folder / NOTES, said)


def _is_doubtful(table: Table) -> bool:
    """Whether a number can be read in two ways: its writer has to see it as it was written."""
    return any(
        isinstance(table.number(place, cell), Doubtful)
        for line in table.lines
        for place, cell in enumerate(line.cells)
        if "." in cell or "," in cell
    )


def _plain(table: Table, place: int, cell: str) -> str:
    number = table.number(place, cell) if place in table.comma_columns and "," in cell else None
    return numbers.plain(number) if isinstance(number, Decimal) else cell


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _write(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
