"""Records each export in the audit trail: by whom, when, its filter, and the files' SHA-256."""

from __future__ import annotations

import hashlib
from collections.abc import Generator, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime import private_files
from app.services.runtime.errors import ConflictError

from .filters import in_words
from .stream import File
from .table import Request

EXPORTED: Final = "data exported"
IDENTITIES: Final = "identities exported"
REPORTED: Final = "report made"
#: The form of an export of one person's data, their platform ids among it.
PERSON: Final = "person"
ACTIONS: Final = (EXPORTED, IDENTITIES, REPORTED)

_CHUNK = 1 << 16


def recorded(
    app: AppContext, actor: str, request: Request, form: str, name: str, pieces: Iterable[bytes]
) -> Generator[bytes]:
    """Pass the chunks of one file through, and record the export when they end or are aborted."""
    digest, size, is_whole = hashlib.sha256(), 0, False
    try:
        for piece in pieces:
            if piece:
                digest.update(piece)
                size += len(piece)
                yield piece
        is_whole = True
    finally:
        more = {} if is_whole else {"incomplete": f"broken off after {size} bytes"}
        files = {name: digest.hexdigest()} if is_whole else {}
        record_export(app, actor, request, form, files, **more)


def record_export(
    app: AppContext, actor: str, request: Request, form: str, files: Mapping[str, str], **more: Any
) -> None:
    """Record one export. files: SHA-256 by file name, 64 hex digits."""
    action = {"report": REPORTED, "identities": IDENTITIES, PERSON: IDENTITIES}.get(form, EXPORTED)
    slug = request.study.slug
    said = {"format": form, "filter": in_words(request), "files": dict(files), **more}
    audit_log.note_alone(app, actor, action, slug, **said)


def write_folder(
    app: AppContext,
    actor: str,
    request: Request,
    form: str,
    files: Iterable[File],
    folder: Path,
    *,
    overwrite: bool = False,
) -> list[Path]:
    """Write all files of one snapshot into a folder, or none; record it, and return their paths.

    Files and new folders are private to the user. An existing file is replaced if it has the same
    content or is an unmodified earlier export. Raises ConflictError for any other existing file,
    unless `overwrite` is set.
    """
    private_files.make_folder(folder)
    written: dict[str, str] = {}
    parts: list[tuple[Path, Path]] = []
    try:
        with app.database.read() as db:
            for file in files:
                path = folder / file.path
                private_files.make_folder(path.parent)
                part = path.with_name(f".{path.name}.part")
                parts.append((part, path))
                digest = hashlib.sha256()
                with private_files.written(part) as out:
                    for piece in file.pieces(db):
                        digest.update(piece)
                        out.write(piece)
                written[file.path] = digest.hexdigest()
        if not overwrite:
            _refuse_to_overwrite(app, request.study.slug, folder, written)
        for part, path in parts:
            part.replace(path)
    finally:
        for part, _ in parts:
            part.unlink(missing_ok=True)
    record_export(app, actor, request, form, written)
    return [path for _, path in parts]


def _refuse_to_overwrite(
    app: AppContext, slug: str, folder: Path, written: Mapping[str, str]
) -> None:
    ours = {
        digest
        for line in audit_log.trail(app, slug, ACTIONS, limit=1_000)
        for digest in line.details.get("files", {}).values()
    }
    for name, digest in written.items():
        path = folder / name
        if path.exists() and _sha256(path) not in ours | {digest}:
            raise ConflictError(
                f"expected another folder, or --overwrite: {path} holds something else"
            )


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(_CHUNK):
            digest.update(piece)
    return digest.hexdigest()
