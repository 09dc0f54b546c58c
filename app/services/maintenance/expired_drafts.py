"""Studies being made that nobody went on with: thrown away after a while without a change."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, select

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.drafts.drafts import Draft
from app.storage.models.records import StudyDraft

#: A folder without a row is of an upload that is under way, or of one that was cut off long ago.
_UPLOADS_LAST = timedelta(days=1)


def kept_until(app: AppContext, draft: Draft) -> datetime:
    """When the draft is thrown away if nothing of it changes."""
    return draft.changed_at + _kept(app)


def sweep(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Throw away what is due; how many went. stop: asked before each; True ends the sweep."""
    with app.database.read() as db:
        rows = db.execute(select(StudyDraft.public_id, StudyDraft.changed_at)).all()
    due_since = app.now() - _kept(app)
    gone = 0
    for public_id, changed_at in rows:
        if changed_at <= due_since and not stop():
            gone += _delete_draft(app, public_id, due_since)
    return gone + _clear_folders(app, {row.public_id for row in rows}, stop)


def _delete_draft(app: AppContext, public_id: str, due_since: datetime) -> int:
    """1 if it went; 0 if it has gone already, or was changed meanwhile."""
    with app.database.write() as db:
        found = db.scalar(
            delete(StudyDraft)
            .where(StudyDraft.public_id == public_id, StudyDraft.changed_at <= due_since)
            .returning(StudyDraft.id)
        )
        if found is None:
            return 0
        audit_log.note(
            db, app.now(), audit_log.RETENTION_RULE, "old draft removed", None, draft=public_id
        )
    shutil.rmtree(drafts.folder_of(app, public_id), ignore_errors=True)
    return 1


def _clear_folders(app: AppContext, known: set[str], stop: Callable[[], bool]) -> int:
    """Folders of drafts that do not exist; `known` were there before any folder was looked at."""
    root = drafts.folder_of(app, "")
    gone = 0
    for path in sorted(root.iterdir()) if root.is_dir() else ():
        is_old = datetime.fromtimestamp(path.stat().st_mtime, UTC) <= app.now() - _UPLOADS_LAST
        if path.name not in known and is_old and not stop():
            shutil.rmtree(path, ignore_errors=True)
            gone += 1
    return gone


def _kept(app: AppContext) -> timedelta:
    return timedelta(days=app.settings.drafts_kept_days)
