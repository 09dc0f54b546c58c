"""Repeats, in a restored database, the deletions since its backup, by the deletion log."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import delete, select

from app.services import deletion_log
from app.services.context import AppContext
from app.services.deletion_log import Deleted
from app.services.sessions import deletion
from app.services.studies import deleted_studies, repository
from app.storage.models.studies import Identity, SessionRow, Study


def apply(app: AppContext, lines: Iterable[Deleted]) -> int:
    """Delete what the log's lines name, and return the number of deletions.

    Lines whose session or study is not in the database are ignored.
    """
    by_key = {(line.what, line.key): line for line in lines}
    done = 0
    with app.database.write() as db:
        for study in db.scalars(select(Study)).all():
            key = deletion_log.study_key(study.slug, study.created_at)
            if line := by_key.get((deletion_log.STUDY, key)):
                deleted_studies.note(db, study, line.day)
                repository.delete_row(db, study)
                done += 1
        kept = db.execute(select(SessionRow.id, SessionRow.token_hash)).all()
        for row_id, token_hash in kept:
            key = deletion_log.session_key(token_hash)
            if line := by_key.get((deletion_log.WISH, key)) or by_key.get(
                (deletion_log.RETENTION, key)
            ):
                session = db.get(SessionRow, row_id)
                # Deleting an earlier session of the same participant may have deleted this one.
                if session is not None:
                    reason: deletion.Reason = (
                        "wish" if line.what == deletion_log.WISH else "retention"
                    )
                    deletion.delete_session(app, db, session, reason, line.day)
                    db.expire_all()
                    done += 1
            elif (deletion_log.IDENTITIES, key) in by_key:
                person = db.get_one(SessionRow, row_id).participant_id
                db.execute(delete(Identity).where(Identity.participant_id == person))
                done += 1
    app.database.scrub()
    return done
