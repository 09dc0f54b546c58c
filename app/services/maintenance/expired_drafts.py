"""Deletes study drafts that have not been changed for a number of days, and leftover folders."""

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

#: A folder without a row and younger than this may belong to an upload in progress.
_UPLOADS_LAST = timedelta(days=1)


def kept_until(app: AppContext, draft: Draft) -> datetime:
    """When the draft expires unless it is changed."""
    return draft.changed_at + _kept(app)


def delete_expired(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete expired drafts, and return their number. stop: called before each; True ends it."""
    with app.database.read() as db:
        rows = db.execute(select(StudyDraft.public_id, StudyDraft.changed_at)).all()
    due_since = app.now() - _kept(app)
    gone = 0
    for public_id, changed_at in rows:
        if changed_at <= due_since and not stop():
            gone += _delete_draft(app, public_id, due_since)
    return gone + _clear_folders(app, {row.public_id for row in rows}, stop)


def _delete_draft(app: AppContext, public_id: str, due_since: datetime) -> int:
    """Delete the draft; returns 1, or 0 if it is gone already or was changed meanwhile."""
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
    """Delete folders without a draft. known: ids of the drafts, read before listing folders."""
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
