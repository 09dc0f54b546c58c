"""Studies being made that nobody went on with: thrown away after a while without a change."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, select

from app.storage.records import StudyDraft

from . import audit, drafts
from .drafts import Draft
from .studio import Studio

#: A folder without a row is of an upload that is under way, or of one that was cut off long ago.
_UPLOADS_LAST = timedelta(days=1)


def kept_until(studio: Studio, draft: Draft) -> datetime:
    """When the draft is thrown away if nothing of it changes."""
    return draft.changed_at + _kept(studio)


def sweep(studio: Studio, stop: Callable[[], bool] = lambda: False) -> int:
    """Throw away what is due; how many went. stop: asked before each; True ends the sweep."""
    with studio.database.read() as session:
        rows = session.execute(select(StudyDraft.public_id, StudyDraft.changed_at)).all()
    due_since = studio.now() - _kept(studio)
    gone = 0
    for public_id, changed_at in rows:
        if changed_at <= due_since and not stop():
            gone += _throw_away(studio, public_id, due_since)
    return gone + _clear_folders(studio, {row.public_id for row in rows}, stop)


def _throw_away(studio: Studio, public_id: str, due_since: datetime) -> int:
    """1 if it went; 0 if it has gone already, or was changed meanwhile."""
    with studio.database.write() as session:
        found = session.scalar(
            delete(StudyDraft)
            .where(StudyDraft.public_id == public_id, StudyDraft.changed_at <= due_since)
            .returning(StudyDraft.id)
        )
        if found is None:
            return 0
        audit.note(
            session, studio.now(), audit.RETENTION_RULE, "old draft removed", None, draft=public_id
        )
    shutil.rmtree(drafts.folder_of(studio, public_id), ignore_errors=True)
    return 1


def _clear_folders(studio: Studio, known: set[str], stop: Callable[[], bool]) -> int:
    """Folders of drafts that do not exist; `known` were there before any folder was looked at."""
    root = drafts.folder_of(studio, "")
    gone = 0
    for path in sorted(root.iterdir()) if root.is_dir() else ():
        is_old = datetime.fromtimestamp(path.stat().st_mtime, UTC) <= studio.now() - _UPLOADS_LAST
        if path.name not in known and is_old and not stop():
            shutil.rmtree(path, ignore_errors=True)
            gone += 1
    return gone


def _kept(studio: Studio) -> timedelta:
    return timedelta(days=studio.settings.drafts_kept_days)
