"""Backs up a running installation into one file, and restores it from such a file.

The file is a zip of the database, studies' own videos, the deletion log, and a manifest with the
number of rows of each table and the SHA-256 of each file. Videos of the crane are not included,
since they can be rendered again; videos in an object store are only listed in the manifest.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import select

from app import __version__
from app.services import deletion_log
from app.services.accounts import audit_log
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.drafts import uploads
from app.services.recordings.recordings import FILE, FoundSource
from app.services.runtime import disk_quota
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings
from app.storage import dump_restore
from app.storage.database import Database
from app.storage.models.studies import Recording
from app.study.scaffold import require_empty

from . import reapply_deletions

FORMAT = 1
MANIFEST = "manifest.json"
DATABASE = "database"
LEDGER = "deletions.log"
UPLOADS = "uploads"
_PIECE = 1 << 20

#: Prefix of the temporary folders. A backup that is killed leaves a copy of the database in one.
_UNFINISHED = ".pbpo-backup-"
_BACKUPS_LAST = timedelta(days=1)


@dataclass(frozen=True)
class Backup:
    """The contents of a backup: rows by table, and the number of files besides the database.

    store, elsewhere: the object store that has studies' own videos, and their number; "" and 0 if
    the videos are in the backup.
    """

    made_at: datetime
    schema: str | None
    rows: dict[str, int]
    files: int
    bytes: int
    store: str
    elsewhere: int


@dataclass(frozen=True)
class Restored:
    """The result of a restore: the backup's contents, and the number of repeated deletions.

    missing: number of studies' own videos that are not in the store, or cannot be reached there.
    """

    backup: Backup
    deleted_again: int
    missing: int


def backup(settings: Settings, target: Path, now: datetime) -> Backup:
    """Write everything that cannot be recreated into a new file that only its owner can read.

    Also deletes what killed backups left in the same folder more than a day ago. Raises
    ConflictError if the file exists or the database cannot be read.
    """
    if target.exists():
        raise ConflictError(f"expected a new file, and {target} is there already")
    if not target.parent.is_dir():
        raise ConflictError(f"expected a folder to write to, and {target.parent} is none")
    _delete_unfinished(target.parent, now)
    # Videos are stored uncompressed and make up most of the size; the database compresses well.
    videos = sum(path.stat().st_size for _, path in _other_files(settings) if path.is_file())
    disk_quota.require(settings, target.parent, videos)
    # In the target's folder, so that the finished file can be renamed.
    with tempfile.TemporaryDirectory(prefix=_UNFINISHED, dir=target.parent) as folder:
        copy, part = Path(folder) / DATABASE, Path(folder) / "backup.zip"
        try:
            held = dump_restore.dump(settings.url, copy)
        except dump_restore.DumpError as error:
            raise ConflictError(str(error)) from None
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            files = {DATABASE: _add(archive, DATABASE, copy, packed=True)}
            # After the database, so that all files it refers to exist by then.
            for name, path in _other_files(settings):
                try:
                    files[name] = _add(archive, name, path, packed=name == LEDGER)
                except FileNotFoundError:
                    continue  # deleted in the meantime
            manifest = {
                "format": FORMAT,
                "app_version": __version__,
                "made_at": now.astimezone(UTC).isoformat(timespec="seconds"),
                "database": dump_restore.kind_of(settings.url),
                "schema": held.revision,
                "rows": dict(held.rows),
                "files": files,
                "elsewhere": _elsewhere(settings),
            }
            archive.writestr(MANIFEST, json.dumps(manifest, indent=2) + "\n")
        part.chmod(0o600)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.rename(target)
    return _backup(manifest)


def restore(source: Path, settings: Settings, ledgers: Sequence[Path], now: datetime) -> Restored:
    """Restore a backup into a new or empty folder, and migrate it to the newest schema.

    Every file's hash and every table's number of rows are compared with the manifest. Then all
    deletions in `ledgers`, in the backup's log and in the installation's own are repeated. On any
    error the folder and the database are emptied again. Raises ConflictError.
    """
    if not source.is_file():
        raise ConflictError(f"expected a backup at {source}, and there is no such file")
    lines = [line for path in ledgers for line in deletion_log.read(path)]
    require_empty(settings.data_dir)
    settings.data_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    try:
        manifest = _unpack(source, settings)
        # Before the database is loaded, so that a killed restore cannot lose deletions. The log
        # keeps all lines, because an older backup may be restored later.
        lines = deletion_log.merge(
            settings.deletion_log_path, [*lines, *_ledger_of_backup(settings)]
        )
        with _loaded(source, settings, manifest):
            again, missing = _bring_up_to_date(settings, lines, manifest, now)
    except BaseException:
        for path in settings.data_dir.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        raise
    return Restored(_backup(manifest), again, missing)


def _bring_up_to_date(
    settings: Settings,
    lines: Sequence[deletion_log.Deleted],
    manifest: dict[str, Any],
    now: datetime,
) -> tuple[int, int]:
    """Migrate the restored database and repeat the deletions.

    Returns the number of repeated deletions and of missing videos.
    """
    # The server that opens it later creates the queue of the workers.
    without_workers = settings.model_copy(update={"workers_apart": False})
    app = open_app(without_workers, now=lambda: now, restoring=True)
    try:
        again = reapply_deletions.apply(app, lines)
        _place_videos(app)
        missing = _missing(app)
        audit_log.note_alone(
            app,
            audit_log.COMMAND_LINE,
            "backup restored",
            made_at=manifest["made_at"],
            deleted_again=again,
        )
    finally:
        app.close()
    return again, missing


def _delete_unfinished(folder: Path, now: datetime) -> None:
    for left in folder.glob(f"{_UNFINISHED}*"):
        # A running backup may finish meanwhile, or belong to another user.
        with suppress(OSError):
            newest = max(path.stat().st_mtime for path in (left, *left.iterdir()))
            if datetime.fromtimestamp(newest, UTC) <= now - _BACKUPS_LAST:
                shutil.rmtree(left)


def _other_files(settings: Settings) -> Iterator[tuple[str, Path]]:
    if settings.deletion_log_path.is_file():
        yield LEDGER, settings.deletion_log_path
    # A set, because both may be the same folder.
    found = {
        f"{UPLOADS}/{path.relative_to(folder).as_posix()}": path
        for folder in {settings.uploads_dir, settings.own_videos}
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".part"
    }
    yield from sorted(found.items())


def _elsewhere(settings: Settings) -> dict[str, Any] | None:
    """The object store and the names of studies' own videos; None if they are in a folder."""
    if not settings.recordings_url:
        return None
    database = Database(settings.url)
    try:
        return {"store": settings.recordings_url, "files": _own_videos(database)}
    finally:
        database.close()


def _own_videos(database: Database) -> list[str]:
    statement = select(Recording.locator).where(Recording.source == FILE)
    with database.read() as db:
        return sorted(set(db.scalars(statement)))


def _place_videos(app: AppContext) -> None:
    """Move restored videos into the store, except those of studies that were deleted again."""
    videos = {path.name: path for path in app.settings.uploads_dir.glob("*") if path.is_file()}
    for name in videos.keys() - set(_own_videos(app.database)):
        videos.pop(name).unlink()
    if app.recordings.origin is not None or app.settings.own_videos_dir is not None:
        app.recordings.keep_files(videos)
        for path in videos.values():
            path.unlink()


def _missing(app: AppContext) -> int:
    names = _own_videos(app.database)
    return len(names) - len(app.recordings.sizes(FoundSource(FILE, name) for name in names))


def _add(archive: zipfile.ZipFile, name: str, path: Path, *, packed: bool) -> dict[str, Any]:
    """Add a file to the archive; returns its manifest entry: hash and size of the bytes written."""
    info = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
    # Videos are packed already.
    info.compress_type = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with path.open("rb") as source, archive.open(info, "w", force_zip64=True) as target:
        digest, size = _copy(source, target)
    return {"sha256": digest, "bytes": size}


def _copy(source: Any, target: Any) -> tuple[str, int]:
    digest, size = hashlib.sha256(), 0
    while piece := source.read(_PIECE):
        digest.update(piece)
        size += len(piece)
        target.write(piece)
    return digest.hexdigest(), size


def _unpack(source: Path, settings: Settings) -> dict[str, Any]:
    """Unpack all files into the folder, check them against the manifest, and return it."""
    try:
        with zipfile.ZipFile(source) as archive:
            manifest = _manifest(archive, source)
            kind = dump_restore.kind_of(settings.url)
            if manifest["database"] != kind:
                raise ConflictError(
                    f"expected a backup of a {kind} database, which is what PBPO_DATABASE_URL says,"
                    f" got one of {manifest['database']}"
                )
            for name, said in manifest["files"].items():
                target = settings.data_dir / uploads.safe_name(name)
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(name) as packed, target.open("wb") as file:
                    digest, _ = _copy(packed, file)
                if digest != said["sha256"]:
                    raise ConflictError(f"{source}: {name} is not what was backed up (SHA-256)")
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise ConflictError(f"expected a whole backup, got {source}: {error}") from None
    return manifest


def _ledger_of_backup(settings: Settings) -> list[deletion_log.Deleted]:
    path = settings.data_dir / LEDGER
    path.touch()
    # As a ledger is made: production refuses one that others can read.
    path.chmod(0o600)
    return deletion_log.read(path)


@contextmanager
def _loaded(source: Path, settings: Settings, manifest: dict[str, Any]) -> Iterator[None]:
    """Load the unpacked database; it is removed again if the block raises an exception."""
    unpacked = settings.data_dir / DATABASE
    try:
        with dump_restore.loaded(unpacked, settings.url) as held:
            if dict(held.rows) != manifest["rows"]:
                raise ConflictError(
                    f"{source}: expected {manifest['rows']} rows, got {dict(held.rows)}"
                )
            unpacked.unlink()
            yield
    except dump_restore.DumpError as error:
        raise ConflictError(str(error)) from error


def _manifest(archive: zipfile.ZipFile, source: Path) -> dict[str, Any]:
    try:
        manifest: dict[str, Any] = json.loads(archive.read(MANIFEST))
        form = manifest["format"]
    except (KeyError, TypeError, ValueError):
        raise ConflictError(f"expected a backup, and {source} has no manifest of one") from None
    if form != FORMAT:
        raise ConflictError(f"expected a backup of format {FORMAT}, got {form!r}: use newer code")
    return manifest


def _backup(manifest: dict[str, Any]) -> Backup:
    files = manifest["files"].values()
    elsewhere = manifest.get("elsewhere") or {"store": "", "files": ()}
    return Backup(
        made_at=datetime.fromisoformat(manifest["made_at"]),
        schema=manifest["schema"],
        rows=manifest["rows"],
        files=len(files) - 1,
        bytes=sum(file["bytes"] for file in files),
        store=elsewhere["store"],
        elsewhere=len(elsewhere["files"]),
    )
