"""Studies' own videos that no study has any more: which they may be, and when they go.

Videos are put where they are kept before the database knows of their study, and a draft that is
made again leaves those that it has no more. Their names are noted in the data folder, and a day
later what is noted and in no study is thrown away. Nothing else that lies there is looked at: the
folder, or the store, may be another studio's too, such as of one that was restored to try it.
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
#: Endings of notes: of a study that is being put together, and of what may be in none.
_IN_USE, _ORPHANED = ".under-way", ".left"

#: No study takes so long to be stored.
_STORED_WITHIN = timedelta(days=1)


@contextmanager
def mark_in_use(app: AppContext, names: Collection[str]) -> Iterator[None]:
    """Within this a study with these videos is put together, and nobody throws them away.

    Left by an exception, it leaves them to `sweep`. Raises StoreAwayError if they cannot be noted.
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
    """Have `sweep` look, in a day, whether any study still has these. Raises StoreAwayError."""
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
    """Those that no study has, nor one that is being put together."""
    # First: who is done meanwhile is in the database.
    in_use = [
        _noted(path) for path in _notes(app) if path.suffix == _IN_USE and not _is_old(app, path)
    ]
    kept = db.scalars(select(Recording.locator).where(Recording.locator.in_(names)))
    return set(names).difference(kept, *in_use)


def sweep(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Throw away what is left; how many videos. stop: asked before each note; True ends it.

    Raises StoreAwayError; what could not be thrown away is tried again the next time.
    """
    gone = 0
    for path in _notes(app):
        if stop():
            break
        if not _is_old(app, path):
            continue
        with app.database.read() as db:
            left = unreferenced(app, db, _noted(path))
        app.recordings.delete(left)
        path.unlink(missing_ok=True)
        gone += len(left)
    return gone


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
        return set()  # its study has been stored meanwhile


def _is_old(app: AppContext, path: Path) -> bool:
    try:
        noted_at = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except FileNotFoundError:
        return True
    return noted_at <= app.now() - _STORED_WITHIN
