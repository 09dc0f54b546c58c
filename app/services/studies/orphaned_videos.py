"""Garbage collection of uploaded videos that no study refers to.

Videos are stored before the database knows of their study, and replacing a draft leaves those that
the new one does not have. Their names are written to note files in the data folder. A day later,
the noted videos that no study refers to are deleted. Other files are never touched: the folder or
bucket may be shared with another installation, such as a restored copy.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.recordings import recordings
from app.services.runtime.errors import StoreAwayError
from app.services.runtime.ids import new_public_id
from app.storage.models.studies import Candidate, Recording

_FOLDER = "left-videos"
#: Endings of note files: for videos of a study that is being stored, and for orphans.
_IN_USE, _ORPHANED = ".under-way", ".left"

#: The age at which a note is acted on; storing a study takes less.
_STORED_WITHIN = timedelta(days=1)


@contextmanager
def mark_in_use(app: AppContext, names: Collection[str]) -> Iterator[None]:
    """Context in which these videos are not collected, while their study is being stored.

    An exception turns them into candidates for `sweep`. Raises StoreAwayError if the note file
    cannot be written.
    """
    if not names:
        yield
        return
    path = _note(app, names, _IN_USE)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            path.rename(path.with_suffix(_ORPHANED))
        raise
    path.unlink(missing_ok=True)


def mark_orphaned(app: AppContext, names: Collection[str]) -> None:
    """Note these videos for `sweep`, which checks a day later whether a study refers to them.

    Raises StoreAwayError if the note file cannot be written.
    """
    if names:
        _note(app, names, _ORPHANED)


def of_study(db: Session, study_id: int) -> set[str]:
    """The names of a study's own videos."""
    return set(
        db.scalars(
            select(Recording.locator)
            .join(Candidate, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == study_id, Recording.source == recordings.FILE)
        )
    )


def unreferenced(app: AppContext, db: Session, names: Collection[str]) -> set[str]:
    """Those names that no study refers to, and none that is being stored."""
    # Read before the database: a study stored in between is then found there.
    in_use = [
        _noted(path) for path in _notes(app) if path.suffix == _IN_USE and not _is_old(app, path)
    ]
    kept = db.scalars(select(Recording.locator).where(Recording.locator.in_(names)))
    return set(names).difference(kept, *in_use)


def sweep(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete the noted videos that are unreferenced; return their number.

    stop: checked before each note file; True ends the run. Raises StoreAwayError; what could not be
    deleted is tried again in the next run.
    """
    deleted = 0
    for path in _notes(app):
        if stop():
            break
        if not _is_old(app, path):
            continue
        with app.database.read() as db:
            left = unreferenced(app, db, _noted(path))
        app.recordings.delete(left)
        path.unlink(missing_ok=True)
        deleted += len(left)
    return deleted


def _note(app: AppContext, names: Collection[str], ending: str) -> Path:
    path = app.settings.data_dir / _FOLDER / f"{new_public_id()}{ending}"
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        path.write_text("".join(f"{name}\n" for name in sorted(names)), encoding="utf-8")
    except OSError as error:
        raise StoreAwayError(f"the videos could not be kept: {error.strerror}") from error
    return path


def _notes(app: AppContext) -> list[Path]:
    return sorted((app.settings.data_dir / _FOLDER).glob("*.*"))


def _noted(path: Path) -> set[str]:
    try:
        return set(path.read_text(encoding="utf-8").split("\n")) - {""}
    except FileNotFoundError:
        return set()  # removed meanwhile, since its study has been stored


def _is_old(app: AppContext, path: Path) -> bool:
    try:
        noted_at = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except FileNotFoundError:
        return True
    return noted_at <= app.now() - _STORED_WITHIN
