"""Deleting again, in a restored database, what was deleted after its backup was made."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import delete, select

from app.storage.tables import Identity, SessionRow, Study

from . import deleted_studies, deletion, ledger, studies
from .ledger import Deleted
from .studio import Studio


def apply(studio: Studio, lines: Iterable[Deleted]) -> int:
    """Delete what the ledger names and the database holds; how many deletions that were."""
    by_key = {(line.what, line.key): line for line in lines}
    done = 0
    with studio.database.write() as session:
        for study in session.scalars(select(Study)).all():
            key = ledger.study_key(study.slug, study.created_at)
            if line := by_key.get((ledger.STUDY, key)):
                deleted_studies.note(session, study, line.day)
                studies.delete_row(session, study)
                done += 1
        kept = session.execute(select(SessionRow.id, SessionRow.token_hash)).all()
        for row_id, token_hash in kept:
            key = ledger.session_key(token_hash)
            if line := by_key.get((ledger.WISH, key)) or by_key.get((ledger.RETENTION, key)):
                row = session.get(SessionRow, row_id)
                # A person's first session may have taken this one with it.
                if row is not None:
                    reason: deletion.Reason = "wish" if line.what == ledger.WISH else "retention"
                    deletion.delete_session(studio, session, row, reason, line.day)
                    session.expire_all()
                    done += 1
            elif (ledger.IDENTITIES, key) in by_key:
                person = session.get_one(SessionRow, row_id).participant_id
                session.execute(delete(Identity).where(Identity.participant_id == person))
                done += 1
    studio.database.scrub()
    return done
